#!/usr/bin/env bash
# Makes target/brick: the brick's program, this PC's program and their checksums, from nothing on a fresh Debian or Ubuntu machine.
set -euo pipefail

usage() {
  cat <<'END'
Usage: brick-image/build.sh

Builds, strips and checks onbrick for the EV3's processor, and puts into target/brick:

  onbrick               the brick's program: one static file
  onbrick-linux-CPU     the same for a PC like this one
  SHA256SUMS            their checksums

Installs what is missing: a cross compiler, QEMU, and Rust's standard library for the brick's processor, from rustup if that can fetch
it, else from Debian. Exit codes: 0 done; 1 something could not be built or installed; 3 what was built is not fit for a brick.
END
}

target=armv5te-unknown-linux-gnueabi
# What a brick has room for, everything inside; bytes.
largest=3000000
# The emulated processor, under the name of the brick's kernel.
arm926=(qemu-arm -cpu arm926 -r 4.14.117-ev3dev-2.3.5-ev3)
# System calls that a 4.14 kernel lacks, those from 398 on. The C library's calls for the time after 2038 (clock_gettime64 and its like) are
# not among them: it asks for them first, and goes on with the older ones.
newer='rseq|io_pgetevents|migrate_pages|kexec_file_load|pidfd_[a-z_]*|io_uring_[a-z]*|open_tree|move_mount|fs(open|config|mount|pick)|clone3'
newer+='|close_range|openat2|faccessat2|process_(madvise|mrelease)|epoll_pwait2|mount_setattr|quotactl_fd|landlock_[a-z_]*|memfd_secret'
newer+='|futex_waitv|set_mempolicy_home_node|cachestat|fchmodat2'

cd "$(dirname "${BASH_SOURCE[0]}")/.."
brick=target/brick
# What the checks need and nobody gets: the brick's program with the simulated brick inside, and what it recorded.
check=target/brick-check

say() { printf 'build: %s\n' "$*" >&2; }

# fail CODE MESSAGE [WAY OUT]
fail() {
  printf 'error: %s\n' "$2" >&2
  [ $# -lt 3 ] || printf '  try: %s\n' "$3" >&2
  exit "$1"
}

unfit() { fail 3 "target/brick/onbrick is not fit for a brick: $1"; }

as_root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi; }

# install_packages PACKAGE…
install_packages() {
  [ $# -gt 0 ] || return 0
  command -v apt-get >/dev/null || fail 1 "this needs $*" "install them with your system's packages"
  say "installing $*"
  as_root apt-get update -qq >&2 || fail 1 "apt-get update failed" "look at the network, then again"
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null ||
    fail 1 "could not install $*" "apt-get install $*"
}

# Cross compiler, emulator, and what builds libzmq and libsodium for this PC.
install_tools() {
  local pair packages=()
  for pair in g++=g++ make=make arm-linux-gnueabi-g++=g++-arm-linux-gnueabi qemu-arm=qemu-user; do
    command -v "${pair%%=*}" >/dev/null || packages+=("${pair##*=}")
  done
  [ -e /usr/arm-linux-gnueabi/lib/libc.a ] || packages+=(libc6-dev-armel-cross)
  install_packages ${packages[@]+"${packages[@]}"}
}

# Sets rust to where the standard library for the brick comes from: rustup, debian.
choose_rust() {
  local libraries
  libraries=$(rustc --print target-libdir --target "$target" 2>/dev/null || true)
  if [ -d "${libraries:-/nowhere}" ]; then
    rust=rustup
  elif command -v rustup >/dev/null && timeout 600 rustup -q target add "$target" 2>/dev/null; then
    rust=rustup
  else
    [ -d /usr/lib/rustlib/src/rust/library ] || install_packages rustc-web cargo-web rust-web-src
    rust=debian
  fi
  say "Rust for the brick's processor comes from $rust"
}

# cargo for the brick's processor.
arm_cargo() {
  if [ "$rust" = rustup ]; then
    cargo "$@" --config cross.toml
  else
    # Debian's cargo builds the standard library as well. The PATH keeps rustup's programs out of its way.
    RUSTC_BOOTSTRAP=1 PATH=/usr/bin:/bin cargo "$@" --config cross.toml
  fi
}

# cargo for this PC.
pc_cargo() { if command -v cargo >/dev/null; then cargo "$@"; else /usr/bin/cargo "$@"; fi; }

# build_brick FEATURES FILE
build_brick() {
  say "building with $1"
  arm_cargo build --release --no-default-features --features "$1" || fail 1 "cargo could not build it"
  mkdir -p "$(dirname "$2")"
  arm-linux-gnueabi-strip -o "$2" "target/$target/release/onbrick"
}

build_pc() {
  say "building for this PC"
  pc_cargo build --release || fail 1 "cargo could not build it for this PC"
  strip -o "$brick/onbrick-linux-$(uname -m)" target/release/onbrick
}

# What the file says of itself.
check_file() {
  local header attributes size
  header=$(arm-linux-gnueabi-readelf -h "$brick/onbrick")
  grep -q 'Machine: *ARM$' <<<"$header" || unfit "it is not for ARM"
  grep -q 'Flags:.*Version5 EABI.*soft-float ABI' <<<"$header" || unfit "it is not EABI 5 with soft float"
  attributes=$(arm-linux-gnueabi-readelf -A "$brick/onbrick")
  grep -q 'Tag_CPU_arch: v5TE$' <<<"$attributes" || unfit "it is not for ARMv5TE: $(grep Tag_CPU_arch <<<"$attributes")"
  ! grep -q 'Tag_FP_arch' <<<"$attributes" || unfit "it wants a floating-point unit"
  arm-linux-gnueabi-readelf -d "$brick/onbrick" | grep -q 'no dynamic section' || unfit "it is linked dynamically"
  ! arm-linux-gnueabi-readelf -lW "$brick/onbrick" | grep -q INTERP || unfit "it wants a loader"
  size=$(stat -c %s "$brick/onbrick")
  [ "$size" -le "$largest" ] || unfit "$size bytes are more than $largest"
  say "ARM, EABI 5, soft float, v5TE, static, $size bytes"
}

# json_text FILE: its text, as it stands between the quotes of JSON.
json_text() {
  sed -e 's/\\/\\\\/g' -e 's/"/\\"/g' -e 's/\t/\\t/g' "$1" | awk '{ printf "%s\\n", $0 }'
}

# job FILE: the shipped mission that maps, all of its time, in the simulated arena, recorded into FILE: what `onbrick run` hands to the
# process that drives. An emulated program cannot start that itself.
job() {
  printf '{"mission":{"name":"map","text":"%s"},' "$(json_text brick-image/missions/map.toml)"
  printf '"robot":{"name":"robot","text":"%s"},' "$(json_text brick-image/robot.toml)"
  printf '"brick":{"Simulated":{"world":{"name":"arena","text":"%s"},' "$(json_text src/sim/worlds/arena.toml)"
  printf '"seed":7,"realtime":false}},"start":{"x_m":0.0,"y_m":0.0,"heading_rad":0.0},"set":[],'
  printf '"file":"%s","sync_ns":1000000000,"run":null,"when_abandoned":"go_on"}\n' "$1"
}

# drive FILE COMMAND…: plays the job with a program.
drive() {
  local file=$1 last
  shift
  rm -f "$file"
  last=$(job "$file" | "$@" control | grep -v '^$' | tail -n 1)
  case $last in
    *'"event":"ended"'*'"wanted":true'*) ;;
    *) fail 3 "the mission did not end well with $*: $last" ;;
  esac
}

# A whole mission on an emulated ARM926EJ-S, which refuses any instruction that the brick lacks: recorded as on this PC, byte for byte, and
# without a system call that the brick lacks.
check_mission() {
  local called
  "${arm926[@]}" "$brick/onbrick" --version >/dev/null || unfit "an ARM926EJ-S does not run it"
  drive "$check/pc.mcap" target/release/onbrick
  drive "$check/arm.mcap" "${arm926[@]}" -strace -D "$check/calls" "$check/onbrick-sim"
  cmp "$check/pc.mcap" "$check/arm.mcap" || unfit "it does not record what a PC records"
  say "a mission on an ARM926EJ-S recorded the same $(stat -c %s "$check/pc.mcap") bytes as on this PC"
  grep -q 'fdatasync(' "$check/calls" || fail 1 "QEMU did not list the system calls"
  # One that was answered with ENOSYS (38), after which the mission went on as on the PC, may be refused by the brick as well.
  called=$(grep -E "^[0-9]+ ($newer)\(" "$check/calls" | grep -v 'errno=38' || true)
  [ -z "$called" ] || unfit "it calls what Linux 4.14 lacks: $called"
  say "and without a system call that Linux 4.14 lacks"
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

rm -rf "$brick" "$check"
mkdir -p "$brick" "$check"
install_tools
choose_rust
build_brick link,sim "$check/onbrick-sim"
build_brick link "$brick/onbrick"
build_pc
check_file
check_mission
make_checksums
say "done"
ls -l "$brick" >&2
