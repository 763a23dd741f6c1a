#!/usr/bin/env bash
# A card made by inject.sh in the emulated brick, with its own systemd: at the first start the
# package installs itself and the service comes up; a PC outside, whose key came with the card, sees
# it, starts a mission and fetches the run; another one pairs; after a power cut it all comes up by
# itself; with a configuration that is not this version's, and with a program that was half copied,
# the journal says so and the service stays down.
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
needs debugfs=e2fsprogs sfdisk=fdisk mkfs.vfat=dosfstools mcopy=mtools

image=$work/card.img
# And the next one, for pairing.
port=$((20000 + 2 * ($$ % 5000)))
pc=${ONBRICK:-$checkout/target/debug/onbrick}
tools=${ONBRICK_TOOLS:-$("$checkout/brick-image/emulator/tools.sh")}

# add FILE PATH MODE: what only this test has: instead of the EV3's hardware, the simulated brick.
add() {
  debugfs -w -R "write $1 $2" "$image?$linux" 2>/dev/null >&2
  debugfs -w -R "set_inode_field $2 mode 0100$3" "$image?$linux" 2>/dev/null >&2
}

# Since version 233 systemd reloads nothing without 16 MB of room in /run, and it gives that a fifth
# of the memory; ev3dev's, 232, does not ask.
add_room() {
  echo 'tmpfs /run tmpfs nosuid,nodev,size=24M,mode=755 0 0' >"$work/fstab"
  debugfs -w -R 'rm /etc/fstab' "$image?$linux" 2>/dev/null >&2
  add "$work/fstab" /etc/fstab 644
}

# It stands for hardware, which answers at once whatever else the processor is asked to do, and
# which the service may write to.
add_hardware() {
  cat >"$work/hardware" <<'END'
[Unit]
Description=simulated hardware
Before=onbrick.service
[Service]
CPUSchedulingPolicy=fifo
CPUSchedulingPriority=60
ExecStart=/usr/local/bin/onbrick-sim sim /run/brick --world /usr/local/lib/room.toml
ExecStartPost=/bin/sh -c "until [ -e /run/brick/sys/class/tacho-motor/motor0/position ]; do sleep 0.2; done"
[Install]
WantedBy=multi-user.target
END
  cat >"$work/drop-in" <<'END'
[Unit]
Wants=hardware.service
After=hardware.service
[Service]
ReadWritePaths=/run/brick
ExecStart=
ExecStart=/usr/bin/onbrick serve --brick /run/brick --config /etc/onbrick
ExecStopPost=
ExecStopPost=/usr/bin/onbrick halt --orphaned --brick /run/brick
END
  add "$tools/onbrick-sim" /usr/local/bin/onbrick-sim 755
  add "$checkout/brick-image/emulator/room.toml" /usr/local/lib/room.toml 644
  add "$work/hardware" /etc/systemd/system/hardware.service 644
  debugfs -w -R 'mkdir /etc/systemd/system/onbrick.service.d' "$image?$linux" 2>/dev/null >&2
  add "$work/drop-in" /etc/systemd/system/onbrick.service.d/hardware.conf 644
}

# start SAID: the brick is switched on.
start() {
  "$checkout/brick-image/emulate.sh" --timeout 1500 --image "$image" --forward "$port" \
    --pid "$work/pid" >"$1" 2>&1 </dev/null &
  emulator=$!
}
cut_power() {
  kill -KILL "$(cat "$work/pid")"
  wait "$emulator" || true
}
# shellcheck disable=SC2016  # when it is run
cleaning+=('kill -KILL "$(cat "$work/pid")" 2>/dev/null')

# This PC, with a key of its own, and what it says.
pc() { "$pc" "$@" --keys "$work/keys" >"$work/said" 2>&1; }
key_of() { sed -n 's/^key *//p' | tail -n 1; }

pc key new
key=$(key_of <"$work/said")
"$tests/inject.sh" --keep "$image" --key "$key" >"$work/injected" || {
  cat "$work/injected" && exit 1
}
add_room
add_hardware
# What the brick says of itself, on its console; its public key as well, which a person would
# compare when pairing.
cat >"$work/report.sh" <<'END'
#!/bin/sh
motors() {
  awk '{ n++; if ($0 != "") run++ } END { print n + 0 " motors, " run + 0 " of them run" }' \
    /run/brick/sys/class/tacho-motor/*/state
}
while :; do
  failed=$(systemctl --failed --no-legend --plain | cut -d' ' -f1 | tr '\n' ' ')
  installed=$(dpkg-query -W -f '${Status}' onbrick 2>/dev/null)
  active="$(systemctl is-active onbrick), name $(hostname), failed units: $failed"
  echo "report: $(cut -d. -f1 /proc/uptime) s: $active, onbrick $installed, $(motors)"
  onbrick key show --keys /etc/onbrick/keys 2>/dev/null | sed -n 's/^key/report: key/p'
  if systemctl -q is-failed onbrick; then
    journalctl -u onbrick -o cat -n 12 --no-pager | sed 's/^/report: journal: /'
    echo "report: down after $(systemctl show -p NRestarts --value onbrick) restarts; $(motors)"
  fi
  # The worst that can happen to a mission, and once to this one.
  lock='/run/lock/onbrick-*.lock'
  if [ ! -e /run/killed ] && grep -q 'mission square.*"motors"' $lock 2>/dev/null; then
    touch /run/killed
    systemctl kill --signal=KILL onbrick
    echo "report: killed all of the service's processes"
    sleep 10
    echo "report: after that, $(motors)"
  fi
  sleep 5
done >/dev/console
END
printf '[Service]\nExecStart=/usr/local/bin/report\n[Install]\nWantedBy=multi-user.target\n' \
  >"$work/report"
add "$work/report.sh" /usr/local/bin/report 755
add "$work/report" /etc/systemd/system/report.service 644
units=/etc/systemd/system
debugfs -w -R "symlink $units/multi-user.target.wants/report.service $units/report.service" \
  "$image?$linux" 2>/dev/null

# A person at the brick, who opens the pairing window, looks at the code, and says yes; over and
# over.
echo yes >"$work/yes"
cat >"$work/person" <<'END'
[Service]
ExecStart=/usr/bin/onbrick pair --answers /usr/local/lib/yes
StandardOutput=journal+console
Restart=always
RestartSec=3
[Unit]
StartLimitIntervalSec=0
[Install]
WantedBy=multi-user.target
END
add "$work/yes" /usr/local/lib/yes 644
add "$work/person" /etc/systemd/system/person.service 644
debugfs -w -R "symlink $units/multi-user.target.wants/person.service $units/person.service" \
  "$image?$linux" 2>/dev/null

code() { tr -d '\r' <"$1" | sed -n 's/^\(.*: \)\? *\([0-9]\{3\} [0-9]\{3\}\)$/\2/p' | tail -n 1; }
same_code() {
  [ -n "$(code "$work/answer")" ] && [ "$(code "$work/answer")" = "$(code "$work/first")" ]
}
pc_has_run() { pc runs red && grep -q " finished" "$work/said"; }
active() {
  grep -q 'report: .*: active, name red, failed units: , onbrick install ok installed' "$1"
}

start "$work/first"
check "the package installs itself at the first start and the service comes up" \
  wait_until 1200 active "$work/first"
check "it says so on the console" says "$work/first" "onbrick: installed"
check "and nothing of it went wrong" not grep -q "did not take\|did not start" "$work/first"
check "the brick made its own key" wait_until 600 grep -q 'report: key ' "$work/first"
brick_key=$(tr -d '\r' <"$work/first" | sed -n 's/^report: key *//p' | tail -n 1)
pc key know red "127.0.0.1:$port" "$brick_key"
check "the PC whose key came with the card sees it" wait_until 300 pc status red
cat "$work/said"
stranger() { "$pc" "$@" --keys "$work/stranger" >"$work/answer" 2>&1; }
introduced() {
  stranger pair "127.0.0.1:$((port + 1))" --port "$port" --name stranger --answers "$work/yes" \
    --timeout 60 || { cat "$work/answer" && return 1; }
}
stranger key new
# It was told the brick's key; the brick was not told its.
stranger key know red "127.0.0.1:$port" "$brick_key"
check "a PC with another key is turned away" not stranger status red --timeout 5
check "because its key is not authorised" says "$work/answer" "does not let this PC's key in"
check "a person at the brick opens the pairing window" wait_until 120 says "$work/first" \
  "the pairing window is open"
check "the PC is introduced" introduced
check "with the code that the brick shows" wait_until 30 same_code
check "then it sees the brick" stranger status red
check "the first PC starts a mission" pc start map red --set time_limit_s=10
check "which comes to its end" wait_until 300 pc_has_run
if ! pc_has_run; then pc --json status red && cat "$work/said"; fi
check "and fetches the run" pc fetch red -o "$work/maps"
run=$(find "$work/maps" -name '*.mcap' | head -n 1)
check "which is a whole recording" "$pc" replay "$run"
check "another mission is started" pc start square red
check "and all of the service's processes are killed while it drives" wait_until 300 \
  says "$work/first" "report: killed all of the"
check "systemd has its motors stopped, and says which" wait_until 120 \
  grep -q 'stopped what mission square (process [0-9]*) left behind: outB, outD' "$work/first"
grep -q 'left behind' "$work/first" || tail -n 40 "$work/first"
check "no motor runs then" wait_until 120 says "$work/first" \
  "report: after that, 3 motors, 0 of them run"
check "the service is back by itself" wait_until 300 pc status red
cat "$work/said"
check "and knows that the run was cut" says "$work/said" "last: square"

check "a mission is started" pc start map red
drives() { pc status red && says "$work/said" "running"; }
check "which drives when the power is cut" wait_until 120 drives
cut_power
start "$work/second"
check "after a power cut the service comes up by itself" wait_until 600 active "$work/second"
check "and nothing moves by itself" says "$work/second" "installed, 3 motors, 0 of them run"
check "it knows that the run was cut" wait_until 600 pc status red
check "and says so" says "$work/said" "last: map"
check "and nothing is installed a second time" not says "$work/second" "onbrick: installed"
cut_power

# stays_down SAID NAME WORDS: the brick is switched on; the service says why it cannot come up, and
# does not try for ever.
stays_down() {
  start "$1"
  check "$2: the service stays down" wait_until 600 grep -q 'report: down after ' "$1"
  check "$2: the journal says why" grep -q "report: journal: .*$3" "$1"
  check "$2: so does the console" grep -q "onbrick\[[0-9]*\]: .*$3\|check\[[0-9]*\]: .*$3" "$1"
  # Two more reports, ten seconds later.
  check "$2: it is not tried for ever" wait_until 120 stays_as_it_is "$1"
  check "$2: the motors are still" says "$1" "; 3 motors, 0 of them run"
  tr -d '\r' <"$1" | grep 'report: journal: \|report: down' | sort -u | head -n 8
  cut_power
}
stays_as_it_is() {
  tr -d '\r' <"$1" | grep 'report: down after ' | uniq -c |
    awk '$1 >= 3 { found = 1 } END { exit !found }'
}

# What was not yet in its place when the power was cut would else be put there over what is changed
# now. e2fsck does not get to the end of that in a part of a file: it forgets the offset, and so
# begins again. (1: something was mended.)
settle() {
  local status=0
  dd if="$image" of="$work/linux" bs=512 skip="$linux_sector" status=none
  e2fsck -fy "$work/linux" >"$work/fsck" 2>&1 || status=$?
  [ $status -le 1 ] || { cat "$work/fsck" && return 1; }
  dd if="$work/linux" of="$image" bs=512 seek="$linux_sector" conv=notrunc status=none
  rm "$work/linux"
}

echo 'quta_mb = 5' >"$work/other.toml"
check "what the power cut left is mended" settle
debugfs -w -R 'rm /etc/onbrick/onbrick.toml' "$image?$linux" 2>/dev/null >&2
add "$work/other.toml" /etc/onbrick/onbrick.toml 644
stays_down "$work/third" "a configuration of another version" quota_mb

check "and after the next as well" settle
debugfs -R "dump /usr/bin/onbrick $work/whole" "$image?$linux" 2>/dev/null
head -c $(($(stat -c %s "$work/whole") / 2)) "$work/whole" >"$work/half"
debugfs -w -R 'rm /usr/bin/onbrick' "$image?$linux" 2>/dev/null >&2
add "$work/half" /usr/bin/onbrick 755
stays_down "$work/fourth" "a program that was half copied" "half copied"

grep -h 'report: .*: active' "$work/first" | head -n 1
grep -h 'report: .*: active' "$work/second" | head -n 1
if [ "$failures" != 0 ]; then tail -n 40 "$work/first" "$work/second"; fi
finish
