# shellcheck shell=dash
# What goes wrong on a card: no room, read-only, a configuration of another version, a robot.toml
# that is none. Each says so and how to mend it, ends with the exit code of a refusal or a failure,
# and leaves motors that are still. The date is 1970 here throughout.
expect "the date is 1970" [ "$(date +%Y)" = 1970 ]
brick_up
still() {
  for motor in /tmp/brick/sys/class/tacho-motor/motor*; do
    [ -z "$(cat "$motor/state")" ] || return 1
  done
}
# wrong NAME CODES WORDS COMMAND…: the command ends with one of the codes and says the words.
wrong() {
  name=$1 codes=$2 words=$3
  shift 3
  code=0
  timeout 20 "$@" >/tmp/said 2>&1 || code=$?
  echo "-- $name: exit code $code: $(tail -n 2 /tmp/said | tr '\n' ' ' | cut -c1-300)"
  expect "$name: exit code" [ "$codes" != "${codes#*"$code"}" ]
  expect "$name: it says what" grep -qi "$words" /tmp/said
  expect "$name: motors are still" still
}

mkdir /tmp/full /tmp/locked /tmp/config
mount -t tmpfs -o size=64k full /tmp/full
head -c 60000 /dev/zero >/tmp/full/filler
mount -t tmpfs -o ro locked /tmp/locked
run="onbrick run $(mission map 50 20) --brick /tmp/brick --robot /etc/onbrick/robot.toml"
# shellcheck disable=SC2086  # words
wrong "no room on the card" "1 3" "no space\|full\|room" $run --out /tmp/full/run
# shellcheck disable=SC2086
wrong "a card that is read-only" "3" "read-only" $run --out /tmp/locked/run
echo 'quta_mb = 5' >/tmp/config/onbrick.toml
wrong "a configuration that this version does not know" "3" "quota_mb" \
  onbrick serve --brick /tmp/brick --config /tmp/config

# in_trouble NAME RUNS WORDS: a service that cannot record into RUNS stays up and at rest, so that
# its status can be queried. It says why on its console, which on a brick is journal and console,
# and in its status; and it refuses a run with the same words.
in_trouble() {
  service=
  service_up "$2"
  brick-figures status /tmp/config/socket >/tmp/status
  before=$(probe cpu "$service")
  sleep 10
  after=$(probe cpu "$service")
  grep -i "$3" /tmp/serve.log | cut -c1-300
  expect "$1: the service says so" grep -qi "$3" /tmp/serve.log
  expect "$1: its status says so" grep -qi "$3" /tmp/status
  figure "$1: the service at rest" "$(awk "BEGIN { print ($after - $before) / 1e8 }")" \
    "% of the processor" "<" 2
  # shellcheck disable=SC2086  # words
  wrong "$1: a run through the service" "3" "$3" $run --config /tmp/config
  service_down
}
run="onbrick run $(mission map 50 20) --brick /tmp/brick"
service_up /tmp/runs
brick-figures status /tmp/config/socket >/tmp/status
expect "a date of 1970: the service says so" grep -q "it is 1970, says the clock" /tmp/serve.log
expect "a date of 1970: its status says so" grep -q "it is 1970, says the clock" /tmp/status
service_down
in_trouble "a service on a card that is read-only" /tmp/locked/runs "read-only"
in_trouble "a service on a card without room" /tmp/full/runs "no room"
echo 'name = 3' >/tmp/robot.toml
wrong "a robot.toml that is none" "3" "robot.toml:1" \
  onbrick run map --brick /tmp/brick --robot /tmp/robot.toml --out /tmp/run
brick_down
