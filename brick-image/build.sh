#!/usr/bin/env bash
# Makes target/brick: what goes to a brick, the program for this PC, and their checksums; from
# nothing on a fresh Debian or Ubuntu machine.
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=emulator/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/emulator/common.sh"

usage() {
  cat <<'END'
Usage: brick-image/build.sh [--for PROCESSOR] [--pc FILE]

Builds, strips and checks onbrick for a processor, and puts into target/brick:

  onbrick                     for armv5te, the EV3's and the default: one static file
  onbrick_VERSION_armel.deb   the same as a package, with service, missions and configuration
  onbrick-armv7               for armv7, a Raspberry Pi 2 and later or a BeagleBone
  onbrick_VERSION_armhf.deb   the same as a package
  onbrick-linux-CPU           the program for a PC like this one
  SHA256SUMS                  the checksums of all that is there

With --pc, FILE is the program for a PC, and none is built.

Installs what is missing: a cross compiler, QEMU, and Rust's standard library for the brick's
processor, from rustup if that can fetch it, else from Debian. Exit codes: 0 done; 1 something could
not be built or installed; 3 what was built is not fit for a brick.
END
}

built=${CARGO_TARGET_DIR:-$checkout/target}
brick=$checkout/target/brick
# No larger than this, everything inside; bytes.
largest=6000000
# System calls that a 4.14 kernel lacks, those from 398 on. The C library's calls for the time after
# 2038 (clock_gettime64 and its like) are not among them: it tries them first, and falls back to the
# older ones; `emulate.sh old-kernel` refuses them all.
newer='rseq|io_pgetevents|migrate_pages|kexec_file_load|pidfd_[a-z_]*|io_uring_[a-z]*|open_tree'
newer+='|move_mount|fs(open|config|mount|pick)|clone3|close_range|openat2|faccessat2'
newer+='|process_(madvise|mrelease)|epoll_pwait2|mount_setattr|quotactl_fd|landlock_[a-z_]*'
newer+='|memfd_secret|futex_waitv|set_mempolicy_home_node|cachestat|fchmodat2'

say() { printf 'build: %s\n' "$*" >&2; }

unfit() {
  printf 'error: target/brick/onbrick%s is not fit for a brick: %s\n' "$suffix" "$1" >&2
  exit 3
}

install_tools() {
  needs dpkg-deb=dpkg
  install_compiler
}

build_brick() {
  cross_cargo build --release --no-default-features --features link ||
    fail "the brick's program could not be built"
  "$gnu-strip" -o "$program" "$built/$target/release/onbrick"
}

build_tools() {
  tools=$("$here/tools.sh" "$processor") ||
    fail "the brick's program with the simulated brick could not be built"
}

build_pc() {
  if [ -z "$pc" ]; then
    # On a machine without rustup it is Debian's.
    cargo build --release || fail "the program for this PC could not be built"
    pc=$built/release/onbrick
  fi
  strip -o "$brick/onbrick-linux-$(uname -m)" "$pc"
}

# What the file says of itself.
check_file() {
  local header attributes dynamic segments size
  header=$("$gnu-readelf" -h "$program")
  grep -q 'Machine: *ARM$' <<<"$header" || unfit "it is not for ARM"
  attributes=$("$gnu-readelf" -A "$program")
  "check_$processor" "$header" "$attributes"
  dynamic=$("$gnu-readelf" -d "$program")
  grep -q 'no dynamic section' <<<"$dynamic" || unfit "it is linked dynamically"
  segments=$("$gnu-readelf" -lW "$program")
  ! grep -q INTERP <<<"$segments" || unfit "it wants a loader"
  size=$(stat -c %s "$program")
  [ "$size" -le "$largest" ] || unfit "$size bytes are more than $largest"
  say "$processor, static, $size bytes"
}

# check_PROCESSOR HEADER ATTRIBUTES
check_armv5te() {
  grep -q 'Flags:.*Version5 EABI.*soft-float ABI' <<<"$1" ||
    unfit "it is not EABI 5 with soft float"
  grep -q 'Tag_CPU_arch: v5TE$' <<<"$2" ||
    unfit "it is not for ARMv5TE: $(grep Tag_CPU_arch <<<"$2")"
  ! grep -q 'Tag_FP_arch' <<<"$2" || unfit "it wants a floating-point unit"
}

# A fused multiply-add rounds once where a PC rounds twice, so a replay would differ.
check_armv7() {
  local code fused
  grep -q 'Flags:.*Version5 EABI.*hard-float ABI' <<<"$1" ||
    unfit "it is not EABI 5 with hard float"
  grep -q 'Tag_CPU_arch: v7$' <<<"$2" || unfit "it is not for ARMv7: $(grep Tag_CPU_arch <<<"$2")"
  grep -q 'Tag_FP_arch: VFPv3\(-D16\)\{0,1\}$' <<<"$2" ||
    unfit "it is not for VFPv3: $(grep Tag_FP_arch <<<"$2")"
  # With its symbols, which tell instructions from data.
  code=$("$gnu-objdump" -d --no-show-raw-insn "$built/$target/release/onbrick")
  grep -q '\bvmul\.f64\b' <<<"$code" || fail "objdump did not show what it calculates"
  fused=$(grep -cE '\bvfn?m[as]' <<<"$code" || true)
  [ "$fused" = 0 ] || unfit "$fused of its instructions multiply and add with one rounding"
  # A BeagleBone's processor has none, and refuses them.
  qemu-arm -cpu cortex-a8 "$program" --version >/dev/null || unfit "a Cortex-A8 does not run it"
  say "no fused multiply-add"
}

# drive FILE COMMAND…: the shipped mission that maps, all of its time, in the simulated arena,
# recorded into FILE by the process that drives. It gets its job directly: an emulated program
# cannot start another.
drive() {
  local file=$1 last
  shift
  "${emulated[@]}" "$tools/brick-figures" job brick-image/missions/map.toml simulated "$file" \
    >"$work/job"
  last=$("$@" control <"$work/job" | grep -v '^$' | tail -n 1) || true
  case $last in
    *'"event":"ended"'*'"word":"finished"'* | *'"event":"ended"'*'"word":"time limit"'*) ;;
    *) unfit "a mission did not end well with $*: $last" ;;
  esac
}

# A whole mission on the emulated processor, which refuses any instruction that it lacks: recorded
# as on this PC, byte for byte, and without a system call that the brick lacks. The program is the
# brick's with the simulated brick inside.
check_mission() {
  local called
  "${emulated[@]}" "$program" --version >/dev/null || unfit "${emulated[*]} does not run it"
  drive "$work/pc.mcap" "$pc"
  drive "$work/arm.mcap" "${emulated[@]}" -strace -D "$work/calls" "$tools/onbrick-sim"
  cmp "$work/pc.mcap" "$work/arm.mcap" || unfit "it does not record what a PC records"
  say "a mission on ${emulated[2]} recorded the same" \
    "$(stat -c %s "$work/pc.mcap") bytes as on this PC"
  grep -q 'fdatasync(' "$work/calls" || fail "QEMU did not list the system calls"
  # One that was answered with ENOSYS (38), after which the mission went on as on the PC, may be
  # refused by the brick as well.
  called=$(grep -E "^[0-9]+ ($newer)\(" "$work/calls" | grep -v 'errno=38' || true)
  [ -z "$called" ] || unfit "it calls what Linux 4.14 lacks: $called"
  say "and without a system call that Linux 4.14 lacks"
}

make_package() {
  "$checkout/brick-image/package.sh" "$program" "$(version)" "$brick" "$architecture"
}

processor=armv5te pc=''
while [ $# -gt 0 ]; do
  case $1 in
    --for) value "$@" && processor=$2 && shift ;;
    --pc) value "$@" && pc=$(realpath "$2") && shift ;;
    -h | --help) usage && exit 0 ;;
    *) usage >&2 && exit 2 ;;
  esac
  shift
done
case $processor in
  armv5te | armv7) ;;
  *) fail "$processor is not the processor of a brick" "armv5te, or armv7" ;;
esac
choose_processor "$processor"

cd "$checkout"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
program=$brick/onbrick$suffix
mkdir -p "$brick"
# What was made for another processor stays.
rm -f "$program" "$brick"/onbrick_*_"$architecture".deb "$brick"/onbrick-linux-*
install_tools
install_rust
build_brick
check_file
build_tools
build_pc
check_mission
make_package
make_checksums "$brick"
say "done"
ls -l "$brick" >&2
