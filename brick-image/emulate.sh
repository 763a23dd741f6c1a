#!/usr/bin/env bash
# The emulated EV3: the brick's processor and memory in QEMU, with the brick's file and the mounted
# simulated brick inside.
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=emulator/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/emulator/common.sh"

usage() {
  cat <<'END'
Usage: brick-image/emulate.sh [OPTIONS] SCENARIO [ARGUMENT…]
       brick-image/emulate.sh --shell
       brick-image/emulate.sh --image IMAGE [--forward PORT]

Boots 64 MB ARM926EJ-S (QEMU's versatilepb), as in the EV3, runs SCENARIO inside and ends with its
exit code. SCENARIO is a shell script, or the name of one in brick-image/scenarios. Inside, onbrick
is the brick's own file, onbrick-sim the same with the simulated brick, and the files of /tmp/out
are copied out at the end.

  --exact           time counts guest instructions, 250 million a second, so that figures repeat
  --shell           a prompt instead of a scenario
  --out DIR         where the files of /tmp/out go
  --add FILE:PATH   one more file, at this path inside; can be repeated
  --disk FILE       a raw disk image, /dev/vda inside
  --card            an ext4 image with the brick's file as that disk, for what depends on reading it
  --pid FILE        the emulator's process number goes there: killing it is a power cut
  --timeout S       give up after S seconds of real time (default 600)
  --onbrick FILE    the brick's file (default target/brick/onbrick)
  --tools DIR       onbrick-sim, which measures as well, for the brick's processor
                    (default: built into target/emulator)
  --image IMAGE     boot this SD card image with its own systemd; its console is this terminal
  --forward PORT    with --image: this port of the loopback leads to the brick's link, 5670,
                    and the next one to its pairing window, 5671
  -h, --help        this

Exit codes: the scenario's own; 124 when the time is over; 1 when the emulator cannot start.
END
}

exact=no card=no shell=no out='' disk='' timeout=600 image='' forward='' scenario='' \
  machine_pid='' onbrick='' tools=''
added=() arguments=()
while [ $# -gt 0 ]; do
  case $1 in
    --exact) exact=yes ;;
    --card) card=yes ;;
    --shell) shell=yes ;;
    --out) value "$@" && out=$2 && shift ;;
    --add) value "$@" && added+=("$2") && shift ;;
    --disk) value "$@" && disk=$2 && shift ;;
    --pid) value "$@" && machine_pid=$2 && shift ;;
    --timeout) value "$@" && timeout=$2 && shift ;;
    --onbrick) value "$@" && onbrick=$2 && shift ;;
    --tools) value "$@" && tools=$2 && shift ;;
    --image) value "$@" && image=$2 && shift ;;
    --forward) value "$@" && forward=$2 && shift ;;
    -h | --help) usage && exit 0 ;;
    -*)
      printf 'error: there is no option %s\n\n' "$1" >&2
      usage >&2 && exit 2
      ;;
    *) scenario=$1 && shift && arguments=("$@") && break ;;
  esac
  shift
done
if [ "$shell$image$scenario" = no ]; then usage >&2 && exit 2; fi

needs qemu-system-arm=qemu-system-arm cpio=cpio gzip=gzip \
  arm-linux-gnueabi-gcc=gcc-arm-linux-gnueabi
kernel=$("$here/kernel.sh")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

machine=(qemu-system-arm -M versatilepb -cpu arm926 -m 64M -kernel "$kernel/zImage"
  -dtb "$kernel/versatile-pb.dtb" -no-reboot -monitor none -display none)
# What the guest has written is in the image, or in this machine's memory on its way there: a power
# cut is the emulator's death.
virtio_disk() {
  machine+=(-drive "file=$1,format=raw,if=none,id=d" -device "virtio-blk-pci,drive=d")
}
[ -z "$machine_pid" ] || machine+=(-pidfile "$machine_pid")
[ "$exact" = no ] || machine+=(-icount "shift=2,sleep=off")
[ -z "$disk" ] || virtio_disk "$disk"
words="console=ttyAMA0 quiet video=vfb:178x128-32"

# Debian's busybox for the brick's processor, fetched without adding an architecture to this
# machine.
busybox() {
  local to=$cache/busybox-armel
  [ -e "$to" ] || locked busybox fetch_busybox "$to"
  echo "$to"
}

fetch_busybox() {
  [ -e "$1" ] && return
  local apt=$cache/apt-armel
  rm -rf "$apt" && mkdir -p "$apt/lists/partial" "$apt/archives/partial"
  touch "$apt/status"
  printf '%s\n' 'APT::Architecture "armel";' 'APT::Architectures { "armel"; };' \
    "Dir::State \"$apt\";" "Dir::State::status \"$apt/status\";" \
    "Dir::Cache \"$apt\";" 'Acquire::Languages "none";' 'APT::Sandbox::User "root";' >"$apt/conf"
  (
    cd "$apt"
    export APT_CONFIG=$apt/conf
    { apt-get -qq update && apt-get -qq download busybox-static; } >&2 ||
      fail "cannot fetch busybox-static for armel" \
        "a Debian mirror in /etc/apt/sources.list, or put the file into $cache/busybox-armel"
    dpkg-deb -x busybox-static_*.deb root
    mv root/bin/busybox "$1"
  )
  rm -rf "$apt"
}

# put FILE PATH: into the machine's first file system.
put() { install -D -m 755 "$1" "$work/root/$2"; }

first_file_system() {
  onbrick=${onbrick:-$checkout/target/brick/onbrick}
  [ -f "$onbrick" ] || fail "there is no $onbrick" "brick-image/build.sh, which makes it"
  mkdir -p "$work/root"/{bin,dev,etc}
  put "$(busybox)" bin/busybox
  put "$here/init" init
  put "$here/scenario.sh" lib/scenario.sh
  put "$here/room.toml" lib/room.toml
  put "$onbrick" usr/bin/onbrick
  tools=${tools:-$("$here/tools.sh")}
  put "$tools/onbrick-sim" usr/bin/onbrick-sim
  ln -s onbrick-sim "$work/root/usr/bin/brick-figures"
  arm-linux-gnueabi-gcc -O2 -static -Wall -o "$work/probe" "$here/probe.c"
  put "$work/probe" usr/bin/probe
  local missions
  missions=$(cd "$checkout/brick-image" && find missions -name '*.toml')
  for file in robot.toml $missions; do put "$checkout/brick-image/$file" "etc/onbrick/$file"; done
  printf 'root:x:0:0:root:/root:/bin/sh\nrobot:x:1000:1000:robot:/home/robot:/bin/sh\n' \
    >"$work/root/etc/passwd"
  printf 'root:x:0:\nrobot:x:1000:\n' >"$work/root/etc/group"
  if [ "$card" = yes ]; then
    needs mke2fs=e2fsprogs
    mkdir "$work/card"
    cp "$onbrick" "$work/card/onbrick"
    truncate -s 32M "$work/card.img"
    mke2fs -q -t ext4 -d "$work/card" "$work/card.img"
    virtio_disk "$work/card.img"
  fi
  for pair in ${added[@]+"${added[@]}"}; do put "${pair%%:*}" "${pair#*:}"; done
  if [ -n "$scenario" ]; then
    put "$(scenario_file)" scenario
    echo "${arguments[@]+"${arguments[@]}"}" >"$work/root/arguments"
  fi
  (cd "$work/root" && find . | cpio -o -H newc --quiet -R 0:0 | gzip -1) >"$work/rd.gz"
}

scenario_file() {
  local file
  for file in "$scenario" "$checkout/brick-image/scenarios/$scenario.sh"; do
    [ -f "$file" ] && echo "$file" && return
  done
  fail "there is no scenario $scenario" \
      "one of: $(basename -s .sh "$checkout"/brick-image/scenarios/*.sh | tr "\n" " ")"
}

# QEMU's own word about a register that Linux writes and it does not model; and serial lines end as
# on a teletype.
without_noise() { sed -u -e '/^vpb_sic_write: /d' -e '/^reboot: /d' -e 's/\r$//'; }

run_scenario() {
  touch "$work/code" "$work/out.tgz"
  machine+=(-initrd "$work/rd.gz" -append "$words rdinit=/init" -serial stdio
    -serial "file:$work/code" -serial "file:$work/out.tgz")
  local ended=0
  timeout --foreground "$timeout" "${machine[@]}" </dev/null 2>"$work/qemu.log" | without_noise ||
    ended=$?
  [ "$ended" != 124 ] || { say "gave up after $timeout s" && exit 124; }
  if [ -n "$out" ] && [ -s "$work/out.tgz" ]; then
    mkdir -p "$out" && tar xzf "$work/out.tgz" -C "$out"
  fi
  local code
  code=$(tr -d '\r\n' <"$work/code")
  # QEMU complains of missing sound cards and the like; that matters only where nothing came of it.
  [ -n "$code" ] || cat "$work/qemu.log" >&2
  [ -n "$code" ] || fail "the emulated machine ended without saying how" \
    "look at the last lines above"
  exit "$code"
}

if [ -n "$image" ]; then
  # A card's size must be a power of two for this machine's card reader, so the image is a disk; the
  # partitions are the same.
  virtio_disk "$image"
  # While it works, its time counts instructions, so that the brick's own programs do not exceed
  # their time limits on a busy PC; while it waits, for its disk or for a PC, time is the PC's.
  [ "$exact" = yes ] || machine+=(-icount "shift=2")
  here_port=tcp:127.0.0.1
  [ -z "$forward" ] || machine+=(
    -netdev "user,id=n,hostfwd=$here_port:$forward-:5670,hostfwd=$here_port:$((forward + 1))-:5671"
    -device "virtio-net-pci,netdev=n,romfile=")
  timeout --foreground "$timeout" "${machine[@]}" \
    -append "$words root=/dev/vda2 rw rootwait ip=10.0.2.15::10.0.2.2:255.255.255.0::eth0:off" \
    -serial mon:stdio 2>"$work/qemu.log"
elif [ "$shell" = yes ]; then
  first_file_system
  "${machine[@]}" -initrd "$work/rd.gz" -append "$words rdinit=/init" -serial mon:stdio \
    -serial null -serial null 2>"$work/qemu.log"
else
  first_file_system
  run_scenario
fi
