#!/usr/bin/env bash
# Installs onbrick on a brick that runs ev3dev, over ssh: the package, a name, and this PC's key.
set -euo pipefail

usage() {
  cat <<'END'
Usage: brick-image/install.sh [OPTIONS] [USER@]HOST

Copies the package to the brick and installs it. Can be run again, also to bring in a newer version;
it waits for a mission that runs. HOST is anything that ssh takes, by default with the user robot:
ev3dev.local, ssh://robot@10.0.0.7:22.
  brick-image/install.sh ev3dev.local --name red

  --name NAME    give the brick a name on the network; new ones are all called ev3dev
  --no-key       do not let this PC in; it can be paired later (onbrick pair)
  --deb FILE     the package (default: the one in target/brick for the brick's processor)
  --onbrick FILE this PC's onbrick (default: target/brick/onbrick-linux-CPU, target/release/onbrick
                 or the one in PATH)
  -h, --help     this

ssh asks for the password of the brick's user, and so does sudo on the brick, once; without a
terminal, sudo gets the first line of standard input.
END
}

fail() {
  printf 'error: %s\n' "$1" >&2
  [ $# -lt 2 ] || printf '  try: %s\n' "$2" >&2
  exit "${3:-1}"
}
say() { printf 'install: %s\n' "$*"; }
# The value of an option: value OPTION [VALUE].
value() {
  [ -n "${2-}" ] && return
  printf 'error: %s needs a value\n\n' "$1" >&2
  usage >&2 && exit 2
}

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
host='' name='' deb='' key=yes onbrick=''
while [ $# -gt 0 ]; do
  case $1 in
    --name) value "$@" && name=$2 && shift ;;
    --no-key) key=no ;;
    --deb) value "$@" && deb=$2 && shift ;;
    --onbrick) value "$@" && onbrick=$2 && shift ;;
    -h | --help) usage && exit 0 ;;
    -*)
      printf 'error: there is no option %s\n\n' "$1" >&2
      usage >&2 && exit 2
      ;;
    *)
      if [ -n "$host" ]; then usage >&2 && exit 2; fi
      host=$1
      ;;
  esac
  shift
done
if [ -z "$host" ]; then usage >&2 && exit 2; fi
case $host in
  *@* | ssh://*) ;;
  *) host=robot@$host ;;
esac
if [ -n "$name" ] && ! [[ $name =~ ^[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?$ ]]; then
  fail "$name cannot be a brick's name" "small letters a to z, digits, and - in between; at most 63"
fi
if [ -n "$deb" ] && [ ! -f "$deb" ]; then
  fail "there is no package $deb" "brick-image/build.sh, which makes it"
fi

if [ -z "$onbrick" ]; then
  for file in "$here/../target/brick/onbrick-linux-$(uname -m)" "$here/../target/release/onbrick" \
    "$(command -v onbrick || true)"; do
    if [ -x "$file" ]; then onbrick=$file && break; fi
  done
fi
if [ "$key" = yes ] && [ -z "$onbrick" ]; then
  fail "there is no onbrick for this PC, whose key the brick is to know" \
    "cargo build --release, or --no-key"
fi

# One connection for everything, so that ssh asks for the password once.
work=$(mktemp -d)
control=(-o ControlMaster=auto -o "ControlPath=$work/ssh" -o ControlPersist=60)
trap 'ssh "${control[@]}" -O exit "$host" 2>/dev/null || true; rm -rf "$work"' EXIT
# shellcheck disable=SC2029  # what is expanded here is meant to be
on_brick() { ssh "${control[@]}" "$host" "$@"; }

say "connecting to $host"
on_brick true </dev/null || fail "ssh did not get through to $host" \
  "ssh $host; the password of a new ev3dev is maker" 4
machine=$(on_brick '
  uname -m
  dpkg --print-architecture
  cat /etc/ev3dev-release 2>/dev/null || echo unknown' </dev/null)
{ read -r processor && read -r architecture && read -r release; } <<<"$machine" || true
case $processor/$architecture in
  armv5*/armel) built_by=brick-image/build.sh ;;
  armv7*/armhf | aarch64/armhf) built_by='brick-image/build.sh --for armv7' ;;
  *)
    fail "$host is no board that onbrick is built for: $processor, ${architecture:-not Debian}" \
      "the address of an EV3, a Raspberry Pi 2 or later with a board for motors, or a BeagleBone" 3
    ;;
esac
say "found $release"
[ -n "$deb" ] || deb=$(find "$here/../target/brick" -name "onbrick_*_$architecture.deb" \
  2>/dev/null | sort -V | tail -n 1) || true
[ -n "$deb" ] || fail "there is no package for $architecture in target/brick" \
  "$built_by, which makes it"
case $(basename "$deb") in
  onbrick_*_armel.deb | onbrick_*_armhf.deb)
    [[ $deb == *_$architecture.deb ]] ||
      fail "$(basename "$deb") is not for $host, which takes $architecture" "$built_by"
    ;;
esac

# The brick's sudo: without a password where it needs none, else with one that is asked for once.
password=''
if ! on_brick sudo -n true </dev/null 2>/dev/null; then
  if [ -t 0 ]; then
    IFS= read -rsp "password of ${host%%@*} on the brick, for sudo: " password && echo
  else
    IFS= read -r password || true
  fi
  printf '%s\n' "$password" | on_brick sudo -S -p "''" true 2>/dev/null ||
    fail "the brick's sudo did not take that password" "the password of a new ev3dev is maker" 3
fi
# quoted WORD: for a shell on the other side, whichever it is.
quoted() { printf "'%s'" "${1//\'/\'\\\'\'}"; }
# as_root COMMAND: one command line for the brick's root shell, which gets its files from somewhere
# else than standard input.
as_root() { printf '%s\n' "$password" | on_brick "sudo -S -p '' sh -c $(quoted "$1")"; }

# The file is whole before anything happens; dpkg then unpacks it beside the old version, and
# changes over at once.
sum=$(sha256sum <"$deb" | cut -d' ' -f1)
file=onbrick-$sum.deb
on_brick "
  if cat >$file.part && echo '$sum  $file.part' | sha256sum --quiet -c -; then
    mv $file.part $file
  else
    rm -f $file.part
    exit 1
  fi" <"$deb" ||
  fail "the package did not arrive whole" "is there room on the card? ssh $host df -h"
say "copied $(basename "$deb")"

# First finishes what a power cut left; a version that cannot be installed is replaced by the one
# before, or removed. The output goes to a file, so the installation continues to its end when the
# connection is lost.
install_package() {
  as_root "
    trap '' HUP PIPE
    export DEBIAN_FRONTEND=noninteractive
    home=\$(getent passwd ${user_on_brick} | cut -d: -f6)
    cache=/var/cache/onbrick
    mkdir -p \$cache && : >\$cache/install.log || exit 1
    is_installed() {
      [ \"\$(dpkg-query -W -f '\${db:Status-Status}' onbrick 2>/dev/null)\" = installed ]
    }
    change_over() {
      dpkg --configure -a || echo 'onbrick: dpkg cannot finish what was begun before'
      if dpkg -i --force-confold \$home/$file; then
        mv \$home/$file \$cache/installed.deb && return
      fi
      rm -f \$home/$file
      # A package that refused, because of a run for example, has changed nothing.
      is_installed && return 1
      [ -e \$cache/installed.deb ] && dpkg -i --force-confold \$cache/installed.deb && return 1
      dpkg -r --force-remove-reinstreq onbrick
      return 2
    }
    change_over >>\$cache/install.log 2>&1 &
    tail -n +1 -f --pid \$! \$cache/install.log
    wait \$!"
}
user_on_brick=$(on_brick id -un </dev/null)
code=0
install_package || code=$?
case $code in
  0) ;;
  1) fail "the package was not installed; the version before is still there" \
    "look at what the brick said above" ;;
  2) fail "the package was not installed, and there is none on the brick" \
    "look at what the brick said above" ;;
  *) fail "the connection to the brick was lost; the installation continues by itself" \
    "this command again, in a minute" 4 ;;
esac
say "installed: $(on_brick onbrick --version </dev/null)"

if [ -n "$name" ]; then
  as_root "
    set -e
    echo $name >/etc/hostname
    if grep -q '^127\\.0\\.1\\.1' /etc/hosts; then
      sed -i 's/^127\\.0\\.1\\.1.*/127.0.1.1\\t$name/' /etc/hosts
    else
      printf '127.0.1.1\\t$name\\n' >>/etc/hosts
    fi
    hostname $name
    if [ -d /run/systemd/system ]; then
      systemctl try-restart avahi-daemon.service 2>/dev/null || true
      systemctl try-restart onbrick.service
    fi"
  say "it is called $name now: ssh robot@$name.local"
fi

# The image's password is in every handbook: with it, every user of the network controls this brick.
if as_root "perl -e '
  \$hash = (getpwnam(q($user_on_brick)))[1];
  exit(crypt(q(maker), \$hash) eq \$hash ? 0 : 1)'"; then
  say "warning: the password of $user_on_brick is still the well-known one"
  say "  try: ssh -t $host passwd"
fi

# This PC's key into the brick, and the brick's into this PC's list; what is shown by both sides
# over ssh needs no comparing of codes.
key_in() { sed -n 's/.*"key":"\([^"]*\)".*/\1/p' | grep .; }
introduce() {
  local ours theirs this_pc
  # In the alphabet of names.
  this_pc=$(printf %s "$(id -un)-$(hostname)" |
    tr -c 'A-Za-z0-9._-' - | sed 's/^[^A-Za-z0-9]*//' | cut -c1-64)
  "$onbrick" key show >/dev/null 2>&1 || "$onbrick" key new >/dev/null || return 1
  ours=$("$onbrick" --json key show | key_in) || return 1
  as_root "
    set -e
    cd /
    key() { runuser -u onbrick -- onbrick --json key --keys /etc/onbrick/keys \"\$@\"; }
    key authorise $(quoted "$ours") --name $(quoted "${this_pc:-PC}") >/dev/null
    # The service, which has just started, may make the brick's key at the same moment.
    key show 2>/dev/null || key new 2>/dev/null || key show" >"$work/theirs" || return 1
  theirs=$(key_in <"$work/theirs")
  "$onbrick" key know "$known_as" "$address" "$theirs"
}

address=${host#ssh://}
address=${address#*@}
address=${address%%:*}
[ -z "$name" ] || address=$name.local
# A brick that has a name of its own is known by it, however it was called here.
known_as=${name:-$(on_brick hostname </dev/null)}
[ "$known_as" != ev3dev ] || known_as=$address

if [ "$key" = yes ]; then
  introduce >&2 || fail "the brick is installed, but this PC's key is not in it" \
    "onbrick pair, on the brick and here"
  say "this PC may talk to it: onbrick status $known_as"
fi
say "done"
