#!/usr/bin/env bash
# Power cuts at random moments of a mission: the emulator is killed while the brick records to its
# disk; the next start must find whole records up to the last sync, and motors that are still.
# power-cut.sh [CUTS] (default 3).
set -euo pipefail

cuts=${1:-3}
shift || true
# shellcheck source-path=SCRIPTDIR source=../../brick-image/emulator/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/../../brick-image/emulator/common.sh"
needs mke2fs=e2fsprogs
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
truncate -s 256M "$work/disk"
mke2fs -q -t ext4 "$work/disk"
# Further arguments are emulate.sh's own.
emulate() { "$checkout/brick-image/emulate.sh" --exact --disk "$work/disk" "$@"; }
seen_ms() { sed -n 's/^at \([0-9]*\) ms$/\1/p' "$1" | tail -n 1; }

# drive_until_cut NUMBER LEAST ARGUMENT…
drive_until_cut() {
  local number=$1 least=$2 said=$work/said-$1 emulator moment
  shift 2
  # Once it drives, somewhere in the first ten seconds of the brick's own time.
  moment=$((RANDOM % 10000))
  emulate "$@" --pid "$work/pid" power-cut "$number" "$least" >"$said" 2>&1 &
  emulator=$!
  until [ "$(seen_ms "$said")" ] && [ "$(seen_ms "$said")" -ge "$moment" ]; do
    if ! kill -0 "$emulator" 2>/dev/null; then cat "$said" && return 1; fi
    sleep 0.05
  done
  kill -KILL "$(cat "$work/pid")"
  wait "$emulator" || true
  grep -E '^(figure|ok|FAILED|cut)' "$said" || true
  if grep -q '^FAILED' "$said"; then return 1; fi
}

least=0
for number in $(seq "$cuts"); do
  drive_until_cut "$number" "$least" "$@"
  least=$(($(seen_ms "$work/said-$number") - 1500))
  echo "cut $number: at $((least + 1500)) ms"
done
emulate "$@" power-cut $((cuts + 1)) "$least" end
echo "ok: $cuts power cuts"
