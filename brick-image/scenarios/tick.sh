# shellcheck shell=dash
# What the whole tick costs at 100 Hz: control alone, by its own processor clock; and by stage.
seconds=${1:-30}
brick_up

brick-figures stages /tmp/brick 10 >/tmp/stages
while IFS=: read -r ns stage; do
  figure "stage:$stage" $((ns / 4)) "instructions a tick"
done </tmp/stages

# tick_of MISSION ROOT: how many instructions a tick of this run takes: of control, of them in user code, and in the kernel.
tick_of() {
  control=
  drive "$@"
  # Where it goes, and then, without being looked at, how much it is; start and end of the run are in neither.
  sleep 2
  probe split "$control" 8 >/tmp/split
  before_cpu=$(probe cpu "$control")
  before=$(probe now)
  sleep $((seconds - 12))
  after_cpu=$(probe cpu "$control")
  after=$(probe now)
  arrive
  read -r user kernel </tmp/split
  per_tick=$(awk "BEGIN { printf \"%d\", ($after_cpu - $before_cpu) / 4 / (($after - $before) / 1e7) }")
  in_user=$((per_tick * user / (user + kernel)))
}

tick_of "$(mission map 100 "$seconds")" /tmp/brick
figure "samples of control" $((user + kernel)) "in 8 s"
figure "of a tick in user code" "$in_user" instructions "<=" 120000
figure "of a tick in the kernel" $((per_tick - in_user)) instructions
# On a brick the drivers answer from the kernel; here each reading, and each look whether a motor is still ours, is a message to the
# simulator's process and back, most of the kernel's part.
figure "the whole tick at 100 Hz, control alone" "$per_tick" instructions

# The same without the simulator: a brick of files that stay as they are, whose readings are files of this kernel's own sysfs, as on a brick.
# Its robot stands: its wheels are told to turn so slowly, and its head so little, that standing still is no fault; the pose stays, which saves
# a sine and a cosine.
for device in /tmp/brick/sys/class/*/*/; do find "$device" -type f; done | while read -r file; do
  plain=/tmp/plain${file#/tmp/brick}
  mkdir -p "${plain%/*}"
  cat "$file" >"$plain" 2>/dev/null || true
done
brick_down
standing=/sys/class/net/lo/dev_port
far=/sys/class/net/lo/tx_queue_len
[ "$(cat "$standing")" = 0 ] && [ "$(cat "$far")" = 1000 ]
for motor in /tmp/plain/sys/class/tacho-motor/*; do
  # Nobody keeps its state, and one that stands would contradict each command.
  echo unknown >"$motor/state"
  ln -sf "$standing" "$motor/position"
done
for sensor in /tmp/plain/sys/class/lego-sensor/*; do
  case $(cat "$sensor/driver_name") in
    *-us) ln -sf "$far" "$sensor/value0" ;;
    *) ln -sf "$standing" "$sensor/value0" ;;
  esac
done
sed -i -e 's/left_dps = [-0-9]*, right_dps = [-0-9]*/left_dps = 9, right_dps = 9/' -e 's/do = { head_deg = [-0-9]* }/do = { head_deg = 4 }/' "$(mission map 100 "$seconds")"
tick_of /tmp/map.toml /tmp/plain
figure "the same over files of sysfs, in user code" "$in_user" instructions "<=" 120000
figure "the same over files of sysfs, in the kernel" $((per_tick - in_user)) instructions
figure "the same over files of sysfs" "$per_tick" instructions
