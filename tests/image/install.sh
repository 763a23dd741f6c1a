#!/usr/bin/env bash
# install.sh and `onbrick push` against a real sshd in a Debian armel root, all of it the brick's
# own programs.
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
needs ssh=openssh-client unshare=util-linux dpkg-deb=dpkg

onbrick=${ONBRICK:-$checkout/target/debug/onbrick}
port=$((10000 + $$ % 10000))
host=ssh://robot@127.0.0.1:$port

# The brick: its own host name and mounts, so that what install.sh does to them stays in there.
start_brick() {
  unpack_root
  mkdir -p "$root/run/sshd" "$root/home/robot/.ssh" "$work/ssh"
  ssh-keygen -q -t ed25519 -N '' -f "$work/ssh/key"
  cp "$work/ssh/key.pub" "$root/home/robot/.ssh/authorized_keys"
  chroot "$root" chown -R robot:robot /home/robot/.ssh
  # Every program in there believes to be on the brick's processor.
  echo QEMU_CPU=arm926 >"$root/etc/environment"
  unshare --uts --mount sh -c "
    hostname ev3dev
    mount -t proc proc '$root/proc'
    mount --rbind /dev '$root/dev'
    exec chroot '$root' /usr/bin/env QEMU_CPU=arm926 /usr/sbin/sshd -D -e -p $port \
      -o ListenAddress=127.0.0.1 -o PidFile=none" 2>"$work/sshd.log" &
  cleaning+=("kill $!")
  cat >"$work/ssh/config" <<END
Host 127.0.0.1
  IdentityFile $work/ssh/key
  UserKnownHostsFile $work/ssh/known_hosts
  StrictHostKeyChecking accept-new
  BatchMode yes
END
  # ssh as the person at the PC has it set up.
  mkdir "$work/bin"
  printf '#!/bin/sh\nexec /usr/bin/ssh -F %s "$@"\n' "$work/ssh/config" >"$work/bin/ssh"
  chmod +x "$work/bin/ssh"
  export PATH=$work/bin:$PATH ONBRICK_KEYS=$work/keys
  local tries=300
  until ssh "$host" true </dev/null 2>"$work/said"; do
    tries=$((tries - 1))
    if [ $tries = 0 ]; then cat "$work/said" "$work/sshd.log" && exit 1; fi
    sleep 0.2
  done
}

# install PASSWORD ARGUMENT…
install_onto() {
  local password=$1
  shift
  printf '%s\n' "$password" | "$checkout/brick-image/install.sh" --deb "${with:-$deb}" \
    --onbrick "$onbrick" "$@" "$host" >"$work/said" 2>&1
}
# shellcheck disable=SC2016  # dpkg's own variables
installed() { chroot "$root" dpkg-query -W -f '${Status} ${Version}' onbrick 2>/dev/null; }
version=$(dpkg-deb -f "$deb" Version)

# A version that does not install.
broken=$work/broken
dpkg-deb -R "$deb" "$broken"
sed -i 's/^Version: .*/Version: 9.9.9/' "$broken/DEBIAN/control"
printf '#!/bin/sh\necho "this version is broken" >&2\nexit 1\n' >"$broken/DEBIAN/postinst"
dpkg-deb --root-owner-group -Zxz -b "$broken" "$work/broken.deb" >/dev/null
# And one that does.
next=$work/next
dpkg-deb -R "$deb" "$next"
sed -i 's/^Version: .*/Version: 9.9.8/' "$next/DEBIAN/control"
dpkg-deb --root-owner-group -Zxz -b "$next" "$work/next.deb" >/dev/null

start_brick
check "a wrong password for sudo is refused" not install_onto wrong
check "with a way out" says "$work/said" "try: the password of a new ev3dev"
check "nothing is installed then" [ -z "$(installed)" ]

with=$work/broken.deb
check "a first version that does not install is a failure" not install_onto maker
unset with
check "it says what the brick said" says "$work/said" "this version is broken"
check "and that there is none now" says "$work/said" "there is none on the brick"
check "which is so" [ ! -e "$root/usr/bin/onbrick" ]

install_onto maker --name red || { cat "$work/said" "$work/sshd.log" && exit 1; }
check "it is installed" [ "$(installed)" = "install ok installed $version" ]
check "it runs" ssh "$host" onbrick --version </dev/null
check "the brick has its name" [ "$(cat "$root/etc/hostname")" = red ]
check "at once" [ "$(ssh "$host" hostname </dev/null)" = red ]
check "also among its hosts" grep -q $'^127.0.1.1\tred$' "$root/etc/hosts"
check "the well-known password is warned of" says "$work/said" "is still the well-known one"
check "the brick knows this PC" [ \
  "$(chroot "$root" onbrick key list --keys /etc/onbrick/keys | grep -c "$(id -un)-")" = 1 ]
check "whose key is the service's alone to see" [ \
  "$(chroot "$root" stat -c '%U %a' /etc/onbrick/keys/authorised)" = "onbrick 700" ]
check "this PC knows the brick" grep -qx '\["red"\]' "$work/keys/known_bricks"
check "by the brick's own key" says "$work/keys/known_bricks" \
  "$(chroot "$root" onbrick key show --keys /etc/onbrick/keys | sed -n 's/^key *//p')"
check "no copy is left in robot's folder" [ -z "$(find "$root/home/robot" -name '*.deb*')" ]
echo robot:another | chroot "$root" chpasswd
install_onto another || { cat "$work/said" && exit 1; }
check "it can be run again, and another password is no longer warned of" not says "$work/said" \
  "well-known"
check "the name stays" [ "$(cat "$root/etc/hostname")" = red ]
check "here as well, though it was not given again" [ \
  "$(grep '^\[' "$work/keys/known_bricks")" = '["red"]' ]

# As the first start of a card from inject.sh installs it.
cp "$deb" "$root/var/cache/onbrick/onbrick.deb"
rm "$root/var/cache/onbrick/installed.deb"
cp "$checkout/brick-image/package/install-first" "$root/var/cache/onbrick/"
check "a card installs it" chroot "$root" /var/cache/onbrick/install-first

# The one before is there afterwards, whole.
with=$work/broken.deb
check "a version that does not install is a failure" not install_onto another
unset with
check "the version before is back" [ "$(installed)" = "install ok installed $version" ]
check "and runs" ssh "$host" onbrick --version </dev/null

head -c 100000 "$deb" >"$work/cut.deb"
with=$work/cut.deb
check "half a package is a failure" not install_onto another
unset with
check "and changes nothing" [ "$(installed)" = "install ok installed $version" ]

# A run keeps the next version waiting, and the connection is lost meanwhile.
run_goes_on 1000 &
running=$!
with=$work/next.deb
install_onto another &
installing=$!
unset with
check "an upgrade waits for a run" wait_until 120 says "$root/var/cache/onbrick/install.log" \
  "waiting until it is over"
pkill -KILL -f "ssh -F $work/ssh/config"
wait "$installing" || true
check "a connection that is lost is named" says "$work/said" "the connection to the brick was lost"
is_next() { [ "$(installed)" = "install ok installed 9.9.8" ]; }
check "nothing is put in the old version's place until then" not is_next
kill "$running"
check "it is finished without a connection" wait_until 120 is_next

cat >"$work/mine.toml" <<'END'
name = "mine"
time_limit_s = 5
[machine.drive]
start = "halt"
final = "halt"
[machine.drive.state.halt]
do = { stop = "brake" }
END
check "a mission is pushed" "$onbrick" push "$host" "$work/mine.toml"
check "it is there" cmp "$work/mine.toml" "$root/home/robot/missions/mine.toml"
check "it is robot's" [ "$(chroot "$root" stat -c %U /home/robot/missions/mine.toml)" = robot ]
echo 'name = 3' >"$work/bad.toml"
check "a broken one is refused" not "$onbrick" push "$host" "$work/mine.toml" "$work/bad.toml"
check "and nothing of it arrives" [ ! -e "$root/home/robot/missions/bad.toml" ]
check "an unreachable brick is no answer" [ \
  "$("$onbrick" push ssh://robot@127.0.0.1:1 "$work/mine.toml" >/dev/null 2>&1; echo $?)" = 4 ]
finish
