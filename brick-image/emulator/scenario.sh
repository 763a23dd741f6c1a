# shellcheck shell=dash
# What every scenario has at hand: runs inside the emulated brick, under busybox's shell. $1 is the
# scenario, the rest its arguments.

failures=0

# figure NAME VALUE UNIT [COMPARISON BOUND]: prints a figure; one outside its bound fails the
# scenario at its end.
figure() {
  if [ $# -le 3 ]; then
    echo "figure: $1: $2 $3"
  elif awk "BEGIN { exit !($2 $4 $5) }"; then
    echo "figure: $1: $2 $3 (bound: $4 $5)"
  else
    echo "FAILED: $1: $2 $3, and the bound is $4 $5"
    failures=$((failures + 1))
  fi
}

# expect NAME COMMAND…: a check that is either so or not.
expect() {
  local what=$1
  shift
  if "$@"; then echo "ok: $what"; else
    echo "FAILED: $what ($*)"
    failures=$((failures + 1))
  fi
}

# refuse NAME COMMAND…: it must not be so.
refuse() {
  local what=$1
  shift
  if "$@"; then
    echo "FAILED: $what ($*)"
    failures=$((failures + 1))
  else echo "ok: $what"; fi
}

# wait_for SECONDS COMMAND…: until it is so.
wait_for() {
  tenths=$(($1 * 10))
  shift
  until "$@" >/dev/null 2>&1; do
    tenths=$((tenths - 1))
    [ $tenths -gt 0 ] || return 1
    sleep 0.1
  done
}

# brick_up [WORLD]: the simulated brick below /tmp/brick. The room is a plain one: casting rays at
# the blocks of the world `arena` takes most of this processor.
brick_up() {
  mkdir -p /tmp/brick
  # It stands for hardware, which answers at once whatever else the processor is asked to do.
  probe fifo 60 onbrick-sim sim /tmp/brick --world "${1:-/lib/room.toml}" >/tmp/sim.log 2>&1 &
  sim=$!
  wait_for 60 test -e /tmp/brick/sys/class/tacho-motor/motor0/position || {
    cat /tmp/sim.log
    echo "FAILED: the simulated brick did not come up"
    return 1
  }
}

brick_down() {
  kill -INT "$sim"
  wait "$sim" || true
}

# service_up RUNS: the service, with its recordings in this folder.
service_up() {
  mkdir -p /tmp/config
  printf 'robot = "/etc/onbrick/robot.toml"\nruns = "%s"\n[socket]\npath = "/tmp/config/socket"\n' \
    "$1" >/tmp/config/onbrick.toml
  onbrick serve --brick /tmp/brick --config /tmp/config >/tmp/serve.log 2>&1 &
  service=$!
  wait_for 60 test -S /tmp/config/socket || {
    cat /tmp/serve.log
    echo "FAILED: the service did not come up"
    return 1
  }
}

service_down() {
  kill -TERM "$service"
  wait "$service" || true
}

# linked: the service's link is open: a process listens at port 5670.
linked() { grep -q ':1626 00000000:0000 0A' /proc/net/tcp; }

# drive_through MISSION: a run by the service, in the background; its events are in /tmp/events.
# Returns when it drives.
drive_through() {
  # What the run before said is not taken for this one's.
  rm -f /tmp/events
  (onbrick --json run "$1" --brick /tmp/brick --config /tmp/config 2>&1 && echo '{"exit":0}') \
    >/tmp/events &
  driving=$!
  wait_for 60 grep -q '"event":"status"' /tmp/events || {
    cat /tmp/events /tmp/serve.log
    echo "FAILED: the run did not start"
    return 1
  }
}

# mission NAME RATE SECONDS: the shipped mission of this name, at this rate and for this time.
mission() {
  sed -e '/^rate_hz = /d' -e '/^time_limit_s = /d' \
    -e "s/^name = .*/&\nrate_hz = $2\ntime_limit_s = $3/" \
    "/etc/onbrick/missions/$1.toml" >"/tmp/$1.toml"
  echo "/tmp/$1.toml"
}

# drive MISSION [ROOT]: a run in the background; its events, each with the time at which it came,
# are in /tmp/events. Returns when it drives.
drive() {
  rm -rf /tmp/run /tmp/events
  (onbrick --json run "$1" --brick "${2:-/tmp/brick}" --robot /etc/onbrick/robot.toml \
    --out /tmp/run 2>&1 && echo '{"exit":0}') |
    probe stamp >/tmp/events &
  driving=$!
  wait_for 60 grep -q '"event":"driving"' /tmp/events || {
    cat /tmp/events
    echo "FAILED: the run did not start"
    return 1
  }
  # shellcheck disable=SC2034  # for the scenarios
  control=$(process " control ")
}

# arrive: waits for the run's end, which must be a good one.
arrive() {
  wait "$driving" || true
  if ! grep -q '{"exit":0}' /tmp/events; then
    tail -n 3 /tmp/events
    echo "FAILED: the run did not end well"
    return 1
  fi
}

# process WORDS: the number of the process whose command line has these words in it. One may be gone
# before it is looked at.
process() {
  for folder in /proc/[0-9]*; do
    case $({ tr '\0' ' ' <"$folder/cmdline"; } 2>/dev/null || true) in
      *"$1"*) echo "${folder#/proc/}" && return ;;
    esac
  done
  return 1
}

# field FILE NAME: what the last line of a file of JSON lines says of a number.
field() {
  sed -n "s/.*\"$2\":\\(-\\{0,1\\}[0-9.]*\\).*/\\1/p" "$1" | tail -n 1
}

scenario=$1
shift
# shellcheck disable=SC1090  # the scenario that was asked for
. "$scenario"
[ "$failures" = 0 ] || {
  echo "$failures failed"
  exit 1
}
