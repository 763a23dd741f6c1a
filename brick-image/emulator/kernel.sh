#!/usr/bin/env bash
# Builds the emulated brick's kernel, once, and prints the folder that holds zImage and
# versatile-pb.dtb.
#
# It is kept in the user's cache folder under a hash of its configuration and of this script: only a
# changed one builds the kernel again.
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

if [ $# -gt 0 ]; then
  echo "Usage: kernel.sh    builds the emulated brick's kernel if needed, and prints its folder"
  [ "$1" = --help ] && exit 0 || exit 2
fi

key=$(cat "$here/kernel.config" "${BASH_SOURCE[0]}" | sha256sum | cut -c1-16)
kernel=$cache/kernel-$key

# Debian's source, as its package leaves it; any 6.x will do.
source_archive() {
  local found
  found=$(find /usr/src -maxdepth 1 -name 'linux-source-*.tar.xz' | sort -V | tail -n 1)
  if [ -z "$found" ]; then
    install_packages "$(
      apt-cache depends linux-source 2>/dev/null | sed -n 's/.*Depends: //p' | head -n 1 |
        grep . || echo linux-source
    )"
    found=$(find /usr/src -maxdepth 1 -name 'linux-source-*.tar.xz' | sort -V | tail -n 1)
  fi
  [ -n "$found" ] || fail "no kernel source in /usr/src" "apt-get install linux-source"
  echo "$found"
}

# Every line of our configuration must have been taken: Kconfig drops in silence what it does not
# know or cannot have.
check_configuration() {
  local line missing=0
  while read -r line; do
    case $line in
      '' | '#'* | *=n) continue ;;
    esac
    grep -qxF "$line" "$1" || { say "the kernel's configuration did not take $line"; missing=1; }
  done <"$here/kernel.config"
  [ "$missing" = 0 ] || fail "this kernel source does not fit kernel.config" \
    "Debian's linux-source-6.1"
}

build() {
  # Another process may have built it while this one waited for the lock.
  [ -e "$kernel/zImage" ] && return
  needs make=make gcc=gcc bc=bc bison=bison flex=flex xz=xz-utils \
    arm-linux-gnueabi-gcc=gcc-arm-linux-gnueabi
  local archive work started=$SECONDS
  archive=$(source_archive)
  work=$(mktemp -d "$cache/kernel-build.XXXXXX")
  # shellcheck disable=SC2064  # the folder as it is now
  trap "rm -rf '$work'" EXIT
  say "building the kernel from $(basename "$archive"), once; a few minutes"
  tar xf "$archive" -C "$work" --strip-components=1
  local log=$work/build.log
  (
    cd "$work"
    export ARCH=arm CROSS_COMPILE=arm-linux-gnueabi- KBUILD_BUILD_TIMESTAMP='1 Jan 1970' \
      KBUILD_BUILD_USER=onbrick KBUILD_BUILD_HOST=onbrick
    KCONFIG_ALLCONFIG=$here/kernel.config make -s allnoconfig
    check_configuration .config
    nice make -s -j"$(nproc)" zImage versatile-pb.dtb >"$log" 2>&1 || {
      tail -n 30 "$log" >&2
      fail "the kernel did not build" "its last lines are above"
    }
  )
  mkdir -p "$kernel"
  cp "$work/arch/arm/boot/dts/versatile-pb.dtb" "$kernel/"
  # The name that says it is whole, last.
  cp "$work/arch/arm/boot/zImage" "$kernel/zImage.part"
  mv "$kernel/zImage.part" "$kernel/zImage"
  say "the kernel took $((SECONDS - started)) s; it is kept in $kernel"
}

[ -e "$kernel/zImage" ] || locked kernel build
echo "$kernel"
