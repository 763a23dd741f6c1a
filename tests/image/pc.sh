#!/usr/bin/env bash
# What a person installs on a PC, where there is least: the package by apt in a root of the oldest
# Debian that is kept up, the tarball there, and the program alone in an empty root. After
# `brick-image/release.sh`, and as root. pc.sh [PROCESSOR]: x86_64 or aarch64, which QEMU emulates
# on a machine of the other.
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

suite=bullseye
processor=${1:-$(uname -m)}
choose_processor "$processor"
deb=$(find "$checkout/target/dist" -name "onbrick_*_$architecture.deb" | sort -V | tail -n 1)
tarball=$(find "$checkout/target/dist" -name "onbrick-*-linux-$processor.tar.xz" |
  sort -V | tail -n 1)
for made in "$deb" "$tarball"; do
  [ -e "$made" ] || fail "there is nothing for a PC in target/dist" \
    "brick-image/release.sh $processor, which makes it"
done

# Made once. Its own apt has read the lists.
kept=$cache/pc-$suite-$architecture-1.tar.gz
make_root() {
  [ ! -e "$kept" ] || return 0
  local made started=$SECONDS
  made=$(mktemp -d "$cache/pc.XXXXXX")
  needs debootstrap=debootstrap
  debootstrap --arch="$architecture" --variant=minbase --include=man-db,bash-completion,fish \
    "$suite" "$made/root" >"$made/log" 2>&1 ||
    { tail -n 20 "$made/log" >&2 && fail "debootstrap did not make a root"; }
  cp /etc/resolv.conf "$made/root/etc"
  chroot "$made/root" apt-get update -qq
  chroot "$made/root" useradd --create-home anna
  tar cz -C "$made/root" . >"$kept.part"
  mv "$kept.part" "$kept"
  rm -rf "$made"
  say "the root of $suite took $((SECONDS - started)) s; it is kept in $kept"
}
[ "$(id -u)" = 0 ] || fail "this test needs root" "sudo -E $0"
enable_emulation
locked "pc-$suite-$architecture" make_root
mkdir "$root"
tar xzf "$kept" -C "$root"
cp /etc/resolv.conf "$root/etc"
mount -t proc proc "$root/proc"
cleaning+=("umount '$root/proc'")

in_root() { chroot "$root" env DEBIAN_FRONTEND=noninteractive LC_ALL=C.UTF-8 "$@"; }
# quiet COMMAND…: what it says is shown only if it fails.
quiet() { "$@" >"$work/said" 2>&1 || { cat "$work/said" && return 1; }; }
# as_anna COMMAND: a shell's words, in her home.
as_anna() { chroot "$root" runuser -u anna -- env HOME=/home/anna LC_ALL=C.UTF-8 \
  sh -c "cd && $1"; }
# Everything of ours, but for what is anna's, and the pages that man keeps because it showed them.
ours() { find "$root" -xdev -path "$root/proc" -prune -o -path "$root/home" -prune \
  -o -path "$root/tmp" -prune -o -path "$root/var/cache/man" -prune -o -iname '*onbrick*' -print; }

cp "$deb" "$root/tmp"
check "apt installs it" quiet in_root apt-get install -y -qq "/tmp/$(basename "$deb")"
check "with what mounts a simulated brick" in_root sh -c 'command -v fusermount3 >/dev/null'
check "it says its version" \
  [ "$(in_root onbrick --version)" = "onbrick $(dpkg-deb -f "$deb" Version)" ]
check "a robot explores, and the map is there" as_anna 'onbrick demo --out demo >said &&
  test -s demo/map.svg && test -s demo/map.png && test -s demo/run.mcap &&
  onbrick replay demo/run.mcap >said'
cp "$checkout/tests/data/recordings/0.1.0.mcap" "$root/tmp"
check "a recording of another machine replays bit for bit" as_anna 'onbrick replay /tmp/0.1.0.mcap |
  grep -q "the same, bit for bit"'
check "keys: CURVE is in" as_anna 'onbrick key new >/dev/null'
# Names are the system's matter, which knows those of mDNS, too.
echo "127.0.0.9 red.local" >>"$root/etc/hosts"
as_anna 'onbrick pair red.local' >"$work/said" 2>&1 || true
check "a name that the system knows has its address" says "$work/said" "red.local: no connection"
as_anna 'onbrick pair blue.local' >"$work/said" 2>&1 || true
check "and another has none" says "$work/said" "no machine has this name"
check "the manual is there" \
  in_root sh -c 'man -P cat onbrick-run | grep -q "onbrick run map"'
# shellcheck disable=SC2016  # for the bash in there
check "bash completes" [ "$(in_root bash -c '. /usr/share/bash-completion/bash_completion
  . /usr/share/bash-completion/completions/onbrick
  COMP_WORDS=(onbrick rep) COMP_CWORD=1; _onbrick onbrick rep onbrick; echo "${COMPREPLY[@]}"')" \
  = "repair replay" ]
check "fish reads its completions" \
  in_root fish -n /usr/share/fish/vendor_completions.d/onbrick.fish
in_root apt-get purge -y -qq onbrick >"$work/said" 2>&1
check "purged: nothing of ours is left ($(ours | tr '\n' ' '))" [ -z "$(ours)" ]

tar xJf "$tarball" -C "$root/usr/local" --strip-components=1
check "the tarball runs from /usr/local" as_anna 'onbrick demo --seconds 20 --out again >said'
check "with its manual" in_root sh -c 'man -P cat onbrick | grep -q SUBCOMMANDS'

# No C library, no shell, no /proc: less than Alpine has.
mkdir -p "$work/empty/tmp"
cp "$root/usr/local/bin/onbrick" "$work/empty"
check "alone in an empty root" quiet chroot "$work/empty" /onbrick demo --out /tmp/demo
check "it leaves a map there, too" [ -s "$work/empty/tmp/demo/map.png" ]
finish
