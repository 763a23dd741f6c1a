#!/usr/bin/env bash
# Makes target/brick: what goes to a brick, the program for this PC, and their checksums; from
# nothing on a fresh Debian or Ubuntu machine.
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=emulator/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/emulator/common.sh"

usage() {
  cat <<'END'
Usage: brick-image/build.sh

Builds, strips and checks onbrick for the EV3's processor, and puts into target/brick:

  onbrick                     the brick's program: one static file
  onbrick_VERSION_armel.deb   the same as a package, with service, missions and configuration
  onbrick-linux-CPU           the program for a PC like this one
  SHA256SUMS                  their checksums

Installs what is missing: a cross compiler, QEMU, and Rust's standard library for the brick's
processor, from rustup if that can fetch it, else from Debian. Exit codes: 0 done; 1 something could
not be built or installed; 3 what was built is not fit for a brick.
END
}

target=armv5te-unknown-linux-gnueabi
built=${CARGO_TARGET_DIR:-$checkout/target}
brick=$checkout/target/brick
# No larger than this, everything inside; bytes. The aim is 6,000,000: exploring, landmarks and
# walls made it 6,156,164.
largest=6200000
# The emulated processor, under the name of the brick's kernel.
arm926=(qemu-arm -cpu arm926 -r 4.14.117-ev3dev-2.3.5-ev3)
# System calls that a 4.14 kernel lacks, those from 398 on. The C library's calls for the time after
# 2038 (clock_gettime64 and its like) are not among them: it tries them first, and falls back to the
# older ones; `emulate.sh old-kernel` refuses them all.
newer='rseq|io_pgetevents|migrate_pages|kexec_file_load|pidfd_[a-z_]*|io_uring_[a-z]*|open_tree'
newer+='|move_mount|fs(open|config|mount|pick)|clone3|close_range|openat2|faccessat2'
newer+='|process_(madvise|mrelease)|epoll_pwait2|mount_setattr|quotactl_fd|landlock_[a-z_]*'
newer+='|memfd_secret|futex_waitv|set_mempolicy_home_node|cachestat|fchmodat2'

say() { printf 'build: %s\n' "$*" >&2; }

unfit() {
  printf 'error: target/brick/onbrick is not fit for a brick: %s\n' "$1" >&2
  exit 3
}

install_tools() {
  needs g++=g++ make=make dpkg-deb=dpkg arm-linux-gnueabi-g++=g++-arm-linux-gnueabi \
    qemu-arm=qemu-user
  [ -e /usr/arm-linux-gnueabi/lib/libc.a ] || install_packages libc6-dev-armel-cross
}

# Rust's standard library for the brick's processor: what is there, else rustup's, else Debian's,
# whose source is built along.
install_rust() {
  if [ -d "$(rustc --print target-libdir --target "$target" 2>/dev/null)" ]; then
    say "Rust's target $target is there"
  elif timeout 600 rustup -q target add "$target" 2>/dev/null; then
    say "rustup fetched the target $target"
  else
    [ -d /usr/lib/rustlib/src/rust/library ] || install_packages rustc-web cargo-web rust-web-src
    say "rustup has no target $target here; Debian's compiler builds its standard library as well"
  fi
}

build_brick() {
  arm_cargo build --release --no-default-features --features link ||
    fail "the brick's program could not be built"
  arm-linux-gnueabi-strip -o "$brick/onbrick" "$built/$target/release/onbrick"
}

build_tools() {
  tools=$("$here/tools.sh") ||
    fail "the brick's program with the simulated brick could not be built"
}

build_pc() {
  # On a machine without rustup it is Debian's.
  cargo build --release || fail "the program for this PC could not be built"
  strip -o "$brick/onbrick-linux-$(uname -m)" "$built/release/onbrick"
}

# What the file says of itself.
check_file() {
  local header attributes dynamic segments size
  header=$(arm-linux-gnueabi-readelf -h "$brick/onbrick")
  grep -q 'Machine: *ARM$' <<<"$header" || unfit "it is not for ARM"
  grep -q 'Flags:.*Version5 EABI.*soft-float ABI' <<<"$header" ||
    unfit "it is not EABI 5 with soft float"
  attributes=$(arm-linux-gnueabi-readelf -A "$brick/onbrick")
  grep -q 'Tag_CPU_arch: v5TE$' <<<"$attributes" ||
    unfit "it is not for ARMv5TE: $(grep Tag_CPU_arch <<<"$attributes")"
  ! grep -q 'Tag_FP_arch' <<<"$attributes" || unfit "it wants a floating-point unit"
  dynamic=$(arm-linux-gnueabi-readelf -d "$brick/onbrick")
  grep -q 'no dynamic section' <<<"$dynamic" || unfit "it is linked dynamically"
  segments=$(arm-linux-gnueabi-readelf -lW "$brick/onbrick")
  ! grep -q INTERP <<<"$segments" || unfit "it wants a loader"
  size=$(stat -c %s "$brick/onbrick")
  [ "$size" -le "$largest" ] || unfit "$size bytes are more than $largest"
  say "ARM, EABI 5, soft float, v5TE, static, $size bytes"
}

# drive FILE COMMAND…: the shipped mission that maps, all of its time, in the simulated arena,
# recorded into FILE by the process that drives. It gets its job directly: an emulated program
# cannot start another.
drive() {
  local file=$1 last
  shift
  "${arm926[@]}" "$tools/brick-figures" job brick-image/missions/map.toml simulated "$file" \
    >"$work/job"
  last=$("$@" control <"$work/job" | grep -v '^$' | tail -n 1) || true
  case $last in
    *'"event":"ended"'*'"word":"finished"'* | *'"event":"ended"'*'"word":"time limit"'*) ;;
    *) unfit "a mission did not end well with $*: $last" ;;
  esac
}

# A whole mission on an emulated ARM926EJ-S, which refuses any instruction that the brick lacks:
# recorded as on this PC, byte for byte, and without a system call that the brick lacks. The program
# is the brick's with the simulated brick inside.
check_mission() {
  local called
  "${arm926[@]}" "$brick/onbrick" --version >/dev/null || unfit "an ARM926EJ-S does not run it"
  drive "$work/pc.mcap" "$built/release/onbrick"
  drive "$work/arm.mcap" "${arm926[@]}" -strace -D "$work/calls" "$tools/onbrick-sim"
  cmp "$work/pc.mcap" "$work/arm.mcap" || unfit "it does not record what a PC records"
  say "a mission on an ARM926EJ-S recorded the same" \
    "$(stat -c %s "$work/pc.mcap") bytes as on this PC"
  grep -q 'fdatasync(' "$work/calls" || fail "QEMU did not list the system calls"
  # One that was answered with ENOSYS (38), after which the mission went on as on the PC, may be
  # refused by the brick as well.
  called=$(grep -E "^[0-9]+ ($newer)\(" "$work/calls" | grep -v 'errno=38' || true)
  [ -z "$called" ] || unfit "it calls what Linux 4.14 lacks: $called"
  say "and without a system call that Linux 4.14 lacks"
}

make_package() {
  local version
  version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
  "$checkout/brick-image/package.sh" "$brick/onbrick" "$version" "$brick"
}

make_checksums() {
  local sums
  sums=$(cd "$brick" && sha256sum -- *)
  printf "%s\n" "$sums" >"$brick/SHA256SUMS"
}

case ${1:-} in
  '') ;;
  -h | --help) usage && exit 0 ;;
  *) usage >&2 && exit 2 ;;
esac

cd "$checkout"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
rm -rf "$brick"
mkdir -p "$brick"
install_tools
install_rust
build_brick
check_file
build_tools
build_pc
check_mission
make_package
make_checksums
say "done"
ls -l "$brick" >&2
