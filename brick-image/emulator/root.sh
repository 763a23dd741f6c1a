#!/usr/bin/env bash
# Makes a Debian armel root like that of an ev3dev image, once, and prints the archive it is kept in
# (as root; for tests).
#
# It is of today's Debian, because that of 2017 is gone from the mirrors; users, groups and files
# are as on ev3dev's images: the user robot with its well-known password, the group ev3dev,
# /etc/ev3dev-release, ssh and sudo.
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

if [ $# -gt 0 ]; then
  echo "Usage: root.sh    makes a Debian armel root like ev3dev's if needed, and prints its archive"
  [ "$1" = --help ] && exit 0 || exit 2
fi

suite=bookworm
contents=systemd-sysv,udev,dbus,iproute2,openssh-server,sudo,procps
key=$(sha256sum "${BASH_SOURCE[0]}" | cut -c1-16)
archive=$cache/root-$key.tar.gz

like_ev3dev() {
  local root=$1
  chroot "$root" groupadd --system ev3dev
  chroot "$root" useradd --create-home --shell /bin/bash --groups sudo,ev3dev,input,video robot
  chmod 755 "$root/home/robot"
  echo robot:maker | chroot "$root" chpasswd
  echo ev3dev >"$root/etc/hostname"
  printf '127.0.0.1\tlocalhost\n127.0.1.1\tev3dev\n' >"$root/etc/hosts"
  echo onbrick-test-image >"$root/etc/ev3dev-release"
  mkdir -p "$root/var/lib/connman"
  rm -rf "$root"/var/cache/apt/archives/*.deb "$root"/var/lib/apt/lists/*
}

build() {
  [ -e "$archive" ] && return
  local work started=$SECONDS
  work=$(mktemp -d "$cache/root-build.XXXXXX")
  # shellcheck disable=SC2064  # the folder as it is now
  trap "rm -rf '$work'" EXIT
  needs debootstrap=debootstrap
  enable_emulation
  say "making a Debian armel root, once; a few minutes"
  debootstrap --arch=armel --variant=minbase --include="$contents" "$suite" "$work/root" \
    >"$work/log" 2>&1 || {
    tail -n 20 "$work/log" >&2
    fail "debootstrap did not make a root" "its last lines are above"
  }
  like_ev3dev "$work/root"
  tar cz -C "$work/root" . >"$archive.part"
  mv "$archive.part" "$archive"
  say "the root took $((SECONDS - started)) s; it is kept in $archive"
}

[ "$(id -u)" = 0 ] || fail "this needs root, for the files' owners" "sudo -E $0"
# Tests that unpack it run its programs.
enable_emulation >&2
[ -e "$archive" ] || locked root build
echo "$archive"
