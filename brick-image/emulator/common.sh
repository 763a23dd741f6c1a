# shellcheck shell=bash
# What the emulator's scripts share: sourced, never run.

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
checkout=$(cd "$here/../.." && pwd)
cache=${XDG_CACHE_HOME:-$HOME/.cache}/onbrick
# shellcheck disable=SC2034  # for the scripts that source this
readonly here checkout cache
# Where an ordinary user's PATH does not lead: sfdisk, mkfs.vfat, debugfs.
PATH=$PATH:/usr/sbin:/sbin

say() { printf 'emulate: %s\n' "$*" >&2; }

# fail MESSAGE [WAY OUT]
fail() {
  printf 'error: %s\n' "$1" >&2
  [ $# -lt 2 ] || printf '  try: %s\n' "$2" >&2
  exit 1
}

# The value of an option: value OPTION [VALUE]; `usage` is the script's.
value() {
  [ -n "${2-}" ] && return
  printf 'error: %s needs a value\n\n' "$1" >&2
  usage >&2 && exit 2
}

as_root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi; }

# needs COMMAND=PACKAGE…: installs the Debian or Ubuntu packages of the commands that are not there.
needs() {
  local pair packages=()
  for pair; do
    command -v "${pair%%=*}" >/dev/null || packages+=("${pair##*=}")
  done
  install_packages ${packages[@]+"${packages[@]}"}
}

install_packages() {
  [ $# -gt 0 ] || return 0
  command -v apt-get >/dev/null || fail "this needs $*" "install them with your system's packages"
  say "installing $*"
  locked packages install_now "$@"
}

# Another program may hold apt's locks for a while, as unattended upgrades do: it is waited for, ten
# minutes at most. apt waits by itself for the lock of dpkg alone, not for that of the lists.
install_now() {
  local said end=$((SECONDS + 600)) \
    apt_get=(env DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=600)
  until said=$(as_root "${apt_get[@]}" update -qq 2>&1); do
    case $said in
      *"Could not get lock"*) [ $SECONDS -lt $end ] && sleep 2 && continue ;;
    esac
    fail "apt-get update failed: $said" "look at the network, then again"
  done
  said=$(as_root "${apt_get[@]}" install -y -qq --no-install-recommends "$@" 2>&1) ||
    fail "could not install $*: $said" "apt-get install $*"
}

# Only one builds into the cache at a time; the others wait for it.
# locked NAME COMMAND…
locked() {
  local name=$1
  shift
  mkdir -p "$cache"
  (
    flock 9
    "$@"
  ) 9>"$cache/$name.lock"
}

# choose_processor NAME: what building for a processor, and emulating it, takes; armv5te is the
# EV3's, armv7 that of a Raspberry Pi 2 and later and of a BeagleBone, the others are PCs'.
# shellcheck disable=SC2034  # for the scripts that source this
choose_processor() {
  case $1 in
    armv5te)
      target=armv5te-unknown-linux-gnueabi gnu=arm-linux-gnueabi architecture=armel suffix=''
      # Under the name of the brick's kernel.
      emulated=(qemu-arm -cpu arm926 -r 4.14.117-ev3dev-2.3.5-ev3)
      ;;
    armv7)
      target=armv7-unknown-linux-gnueabihf gnu=arm-linux-gnueabihf architecture=armhf suffix=-armv7
      emulated=(qemu-arm -cpu cortex-a7 -r 4.14.117-ev3dev-2.3.5-rpi2)
      ;;
    x86_64 | aarch64)
      target=$1-unknown-linux-gnu gnu=$1-linux-gnu suffix=-linux-$1 architecture=amd64
      [ "$1" = x86_64 ] || architecture=arm64
      emulated=()
      [ "$1" = "$(uname -m)" ] || emulated=("qemu-$1")
      ;;
    *) fail "there is no processor $1 here" "armv5te, armv7, x86_64, or aarch64" ;;
  esac
}

# Unless a script chooses another.
choose_processor armv5te
# What forks beside other threads hangs in QEMU before 8.0, as in `.cargo/config.toml`.
export G_SLICE=always-malloc

# Lets the kernel start the chosen processor's programs by QEMU (as root); a rule of our own,
# because Debian's does not let programs change their user, and sudo must.
enable_emulation() {
  [ ${#emulated[@]} != 0 ] || return 0
  local qemu=${emulated[0]}-static rules=/proc/sys/fs/binfmt_misc class='\x01' machine='\x28'
  local rule=onbrick-${emulated[0]#qemu-}
  needs "$qemu=qemu-user-static"
  [ -e $rules/register ] || mount -t binfmt_misc binfmt_misc $rules
  [ ! -e "$rules/$rule" ] || return 0
  [ "${emulated[0]}" != qemu-aarch64 ] || class='\x02' machine='\xb7'
  # A little-endian ELF file of 32 or 64 bits for the machine: magic, mask, and F (opened now, so
  # that it works in other roots), O and C (as its own user).
  local magic="\x7fELF$class\x01\x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x02\x00$machine\x00"
  local mask='\xff\xff\xff\xff\xff\xff\xff\x00\xff\xff\xff\xff\xff\xff\xff\xff\xfe\xff\xff\xff'
  printf '%s' ":$rule:M::$magic:$mask:$(command -v "$qemu"):OCF" >$rules/register
  say "from now on this kernel runs programs for $target by QEMU, until the next start;" \
    "echo -1 >$rules/$rule ends it"
}

# The C and C++ compiler for the chosen processor, its C library, and what starts its programs.
install_compiler() {
  needs g++=g++ make=make "$gnu-g++=g++-${gnu//_/-}"
  [ "$gnu" = "$(uname -m)-linux-gnu" ] || [ -e "/usr/$gnu/lib/libc.a" ] ||
    install_packages "libc6-dev-$architecture-cross"
  [ ${#emulated[@]} = 0 ] || needs "${emulated[0]}=qemu-user"
}

# Rust's standard library for the chosen processor: what is there, else rustup's, else Debian's,
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

# cross_cargo ARGUMENTS…: cargo for the chosen processor, with whichever compiler is there
# (install_rust installs one).
cross_cargo() {
  # A setting among the arguments prevails over the file's.
  set -- "$1" --config "$checkout/cross.toml" --target "$target" "${@:2}"
  if [ -d "$(rustc --print target-libdir --target "$target" 2>/dev/null)" ]; then
    cargo "$@"
  elif [ -d /usr/lib/rustlib/src/rust/library ]; then
    # Debian's, which builds the standard library as well. The PATH keeps rustup's programs out of
    # the way.
    RUSTC_BOOTSTRAP=1 PATH=/usr/bin:/bin cargo "$@"
  else
    fail "there is no Rust compiler for $target" \
      "brick-image/build.sh, which installs one"
  fi
}

# The version that Cargo.toml names.
version() { sed -n 's/^version = "\(.*\)"/\1/p' "$checkout/Cargo.toml" | head -n 1; }

# make_checksums FOLDER: SHA256SUMS of all that is in it.
make_checksums() {
  local sums
  rm -f "$1/SHA256SUMS"
  sums=$(cd "$1" && sha256sum -- *)
  printf "%s\n" "$sums" >"$1/SHA256SUMS"
}
