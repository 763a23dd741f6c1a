#!/usr/bin/env bash
# Everything that is tested on an emulated brick and in Debian roots, one more at a time than there
# are processors, as boot.sh waits for half of its time; each with the seconds that it took; what
# one says is shown at its end. After `brick-image/build.sh` and `brick-image/release.sh x86_64`,
# and as root. all.sh [NAME…]: only these.
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=../../brick-image/emulator/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/../../brick-image/emulator/common.sh"

# What takes longest comes first, so that no long one is left over at the end.
parts=(boot power-cut install package pc inject)
# In time that counts instructions: whatever else the machine does.
scenarios=(memory menu bad-input lateness entropy cost start old-kernel reading)

# among NAME NAME…: whether the first is one of the others.
among() {
  local name=$1 other
  shift
  for other; do [ "$other" != "$name" ] || return 0; done
  return 1
}

for name; do
  among "$name" "${parts[@]}" "${scenarios[@]}" ||
    { echo "error: there is no test $name; there are ${parts[*]} ${scenarios[*]}" >&2 && exit 2; }
done
[ $# -gt 0 ] || set -- "${parts[@]}" "${scenarios[@]}"

# What several of them would else wait for.
"$here/kernel.sh" >/dev/null
"$here/root.sh" >/dev/null
"$here/tools.sh" >/dev/null

said=$(mktemp -d)
trap 'rm -rf "$said"' EXIT

# run NAME: its output, in one piece, when it has ended.
run() {
  local name=$1 started=$SECONDS
  local command=("$checkout/tests/image/$name.sh")
  local card=()
  [ "$name" != start ] || card=(--card)
  among "$name" "${parts[@]}" ||
    command=("$checkout/brick-image/emulate.sh" --exact ${card[@]+"${card[@]}"}
      --timeout 3000 "$name")
  if "${command[@]}" >"$said/$name" 2>&1 </dev/null; then touch "$said/$name.passed"; fi
  {
    flock 9
    printf '\n-- %s\n' "$name"
    cat "$said/$name"
    printf -- '-- %s: %d s\n' "$name" $((SECONDS - started))
  } 9>"$said/lock"
}

for name; do
  while [ "$(jobs -rp | wc -l)" -gt "$(nproc)" ]; do wait -n; done
  run "$name" &
done
wait

failed=()
for name; do [ -e "$said/$name.passed" ] || failed+=("$name"); done
if [ ${#failed[@]} -gt 0 ]; then
  printf '\nfailed: %s\n' "${failed[*]}"
  exit 1
fi
