#!/usr/bin/env bash
# The package in a Debian armel root: installed, upgraded over edited files, held up by a run, found
# half copied, removed, purged.
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

unpack_root
in_root() { chroot "$root" env DEBIAN_FRONTEND=noninteractive "$@"; }
# What belongs to whom, as a word.
owner() { chroot "$root" stat -c '%U:%G %a' "$1"; }
# shellcheck disable=SC2016  # dpkg's own variables
installed() { in_root dpkg-query -W -f '${Status} ${Version}' onbrick; }
# install_deb FILE [WAIT]: the package from outside.
install_deb() {
  cp "$1" "$root/tmp/onbrick.deb"
  in_root env ONBRICK_WAIT_S="${2:-600}" dpkg -i --force-confold /tmp/onbrick.deb >"$work/said" 2>&1
}

install_deb "$deb" || { cat "$work/said" && exit 1; }
check "the program runs" in_root onbrick --version
check "the service's user may use devices and the local socket" [ \
  "$(in_root id -nG onbrick | tr ' ' '\n' | sort | tr '\n' ' ')" = \
  "ev3dev input onbrick robot video " ]
check "runs are the service's, and robot can read them" [ \
  "$(owner /var/lib/onbrick/runs)" = "onbrick:onbrick 755" ]
check "keys are the service's alone" [ "$(owner /etc/onbrick/keys)" = "onbrick:onbrick 700" ]
check "missions are robot's" [ "$(owner /home/robot/missions/map.toml)" = "robot:robot 644" ]
check "so is robot.toml" [ "$(owner /home/robot/robot.toml)" = "robot:robot 644" ]
check "brickman's browser finds the menu" [ \
  "$(owner /home/robot/onbrick-menu)" = "robot:robot 755" ]
check "the service starts with the brick" [ \
  -L "$root/etc/systemd/system/multi-user.target.wants/onbrick.service" ]
check "systemd finds nothing wrong with the unit" \
  in_root systemd-analyze verify --man=no /lib/systemd/system/onbrick.service
check "nor with the menu's" \
  in_root systemd-analyze verify --man=no /lib/systemd/system/onbrick-menu.service
check "every shipped mission is in order" \
  in_root sh -c 'onbrick check /home/robot/missions/*.toml >/dev/null'
check "the program is whole" in_root /usr/lib/onbrick/check

# The next version brings another map mission and another square one.
next=$work/next
dpkg-deb -R "$deb" "$next"
for mission in map square bump; do
  echo "# of the next version" >>"$next/usr/share/onbrick/missions/$mission.toml"
done
sed -i 's/^Version: .*/Version: 9.9.9/' "$next/DEBIAN/control"
dpkg-deb --root-owner-group -Zxz -b "$next" "$work/next.deb" >/dev/null

echo "# edited" >>"$root/home/robot/missions/map.toml"
rm "$root/home/robot/missions/bump.toml"
echo "# edited" >>"$root/etc/onbrick/onbrick.toml"
echo '{"pid":1,"doing":"mission map"}' >"$root/run/lock/onbrick.lock"
run_goes_on 30 &
running=$!
sleep 1
check "an upgrade is refused where the run does not end" not install_deb "$work/next.deb" 2
check "it says whose run it is" says "$work/said" "mission map"
check "and what to do" says "$work/said" "onbrick halt"
check "the old version is still installed" [ \
  "$(installed)" = "install ok installed $(dpkg-deb -f "$deb" Version)" ]
kill "$running"
wait "$running" || true

run_goes_on 6 &
sleep 1
started=$SECONDS
install_deb "$work/next.deb" || cat "$work/said"
check "an upgrade waits for a run that ends" [ $((SECONDS - started)) -ge 4 ]
wait
check "the next version is installed" [ "$(installed)" = "install ok installed 9.9.9" ]
check "an edited mission is kept" says "$root/home/robot/missions/map.toml" "# edited"
check "and only that" not says "$root/home/robot/missions/map.toml" "# of the next version"
check "it says so" says "$work/said" "/home/robot/missions/map.toml was edited and is kept"
check "one that was not is replaced" says "$root/home/robot/missions/square.toml" \
  "# of the next version"
check "one that was deleted stays away" [ ! -e "$root/home/robot/missions/bump.toml" ]
check "an edited configuration is kept" says "$root/etc/onbrick/onbrick.toml" "# edited"

truncate -s 500000 "$root/usr/bin/onbrick"
check "a half-copied program is refused" not in_root /usr/lib/onbrick/check 2>"$work/said"
check "with a message" says "$work/said" "it is half copied, or for another processor"
install_deb "$work/next.deb"
check "installing again mends it" in_root /usr/lib/onbrick/check

# As brick-image/README.md tells a person who wants the menu in brickman's place.
printf '[Service]\nExecStart=/bin/true\n[Install]\nWantedBy=multi-user.target\n' \
  >"$root/lib/systemd/system/brickman.service"
in_root systemctl disable brickman >"$work/said" 2>&1
in_root systemctl enable onbrick-menu >>"$work/said" 2>&1
mkdir -p "$root/var/cache/onbrick"
cp "$deb" "$root/var/cache/onbrick/installed.deb"
in_root dpkg -r onbrick >"$work/said" 2>&1
check "removed: no program" [ ! -e "$root/usr/bin/onbrick" ]
check "removed: runs are kept" [ -d "$root/var/lib/onbrick/runs" ]
wants=$root/etc/systemd/system/multi-user.target.wants
check "removed: nothing starts with the brick" [ -z "$(find "$wants" -name 'onbrick*')" ]
check "removed: brickman has the screen again" [ -L "$wants/brickman.service" ]
in_root dpkg -P onbrick >"$work/said" 2>&1
check "purged: nothing of ours is left" [ -z "$(find "$root" -xdev -path "$root/proc" -prune \
  -o -name '*onbrick*' ! -path "$root/tmp/*" ! -name onbrick.lock -print)" ]
check "purged: nor is the user" not in_root getent passwd onbrick
check "purged: what robot edited is left" says "$root/home/robot/missions/map.toml" "# edited"
check "purged: what was never edited is gone" [ ! -e "$root/home/robot/missions/square.toml" ]
finish
