#!/usr/bin/env bash
# Everything that is tested on an emulated brick and in a Debian armel root, one after the other, each with the seconds that it took; after
# `brick-image/build.sh`, and as root. all.sh [NAME…]: only these.
set -euo pipefail
checkout=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)

# In time that counts instructions.
scenarios=(reading tick start lateness memory entropy old-kernel bad-input menu)
parts=(power-cut package inject install boot)
failed=()

# timed NAME COMMAND…
timed() {
  local name=$1 started=$SECONDS
  shift
  printf '\n-- %s\n' "$name"
  "$@" || failed+=("$name")
  printf -- '-- %s: %d s\n' "$name" $((SECONDS - started))
}

# wanted NAME [NAME…]: whether the first is among the others, or there are none.
wanted() {
  local name=$1 other
  shift
  [ $# -gt 0 ] || return 0
  for other; do [ "$other" != "$name" ] || return 0; done
  return 1
}

for name in "${scenarios[@]}"; do
  if wanted "$name" "$@"; then timed "$name" "$checkout/brick-image/emulate.sh" --exact --timeout 3000 "$name"; fi
done
for name in "${parts[@]}"; do
  if wanted "$name" "$@"; then timed "$name" "$checkout/tests/image/$name.sh"; fi
done
if [ ${#failed[@]} -gt 0 ]; then
  printf '\nfailed: %s\n' "${failed[*]}"
  exit 1
fi
