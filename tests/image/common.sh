# shellcheck shell=bash
# What the tests on a Debian armel root share: sourced, never run. They need root, and QEMU for
# programs of the brick's processor.
tests=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source-path=SCRIPTDIR source=../../brick-image/emulator/common.sh
source "$tests/../../brick-image/emulator/common.sh"
work=$(mktemp -d)
root=$work/root
failures=0
# shellcheck disable=SC2034  # for the tests that source this
deb=${ONBRICK_DEB:-$(find "$checkout/target/brick" -name 'onbrick_*_armel.deb' 2>/dev/null |
  sort -V | tail -n 1 || true)}

# The card that inject.sh makes has ev3dev's layout: 48 MB of FAT, then Linux, from these sectors
# on; the second as mke2fs and debugfs want it.
# shellcheck disable=SC2034
{
  fat_sector=8192
  linux_sector=106496
  linux=offset=$((linux_sector * 512))
}

cleaning=()
clean_up() {
  local command
  for command in ${cleaning[@]+"${cleaning[@]}"}; do eval "$command" || true; done
  rm -rf --one-file-system "$work"
}
trap clean_up EXIT

unpack_root() {
  [ "$(id -u)" = 0 ] || fail "this test needs root" "sudo -E $0"
  mkdir "$root"
  tar xzf "$("$checkout/brick-image/emulator/root.sh")" -C "$root"
  mkdir -p "$root/run/lock"
}

# check NAME COMMAND…
check() {
  local name=$1
  shift
  if "$@"; then echo "ok: $name"; else
    echo "FAILED: $name ($*)"
    failures=$((failures + 1))
  fi
}

not() { ! "$@"; }

# says FILE TEXT: whether a file has it in it.
says() { grep -qF -- "$2" "$1"; }

# wait_until SECONDS COMMAND…
wait_until() {
  local end=$((SECONDS + $1))
  shift
  until "$@" >/dev/null 2>&1; do
    [ $SECONDS -lt $end ] || return 1
    sleep 1
  done
}

# What a run of ours looks like from outside: its lock, held for this many seconds.
run_goes_on() {
  exec 9>>"$root/run/lock/onbrick.lock"
  flock 9
  exec sleep "$1"
}

finish() {
  if [ "$failures" != 0 ]; then
    echo "$failures failed"
    exit 1
  fi
}
