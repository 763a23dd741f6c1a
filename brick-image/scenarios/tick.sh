# shellcheck shell=dash
# What the whole tick costs at 100 Hz: control alone, by its own processor clock; by stage; and how soon the first tick is.
seconds=${1:-30}
brick_up

brick-figures stages /tmp/brick 10 >/tmp/stages
while IFS=: read -r ns stage; do
  figure "stage:$stage" $((ns / 4)) "instructions a tick"
done </tmp/stages

control=
drive "$(mission map 100 "$seconds")"
# Where it goes, and then, without being looked at, how much it is; start and end of the run are in neither.
sleep 2
probe split "$control" 8 >/tmp/split
before_cpu=$(probe cpu "$control")
before=$(probe now)
sleep $((seconds - 12))
after_cpu=$(probe cpu "$control")
after=$(probe now)
arrive

# How soon the first tick is, over plain files with the same texts, so that nobody waits for the simulator; modes are right already.
mkdir -p /tmp/plain/sys
cp -rL /tmp/brick/sys/class /tmp/plain/sys/ 2>/dev/null || true
brick_down
rm -rf /tmp/run
started=$(probe now)
(onbrick --json run /tmp/map.toml --brick /tmp/plain --robot /etc/onbrick/robot.toml --out /tmp/run 2>&1 || true) | probe stamp >/tmp/events &
starting=$!
wait_for 30 grep -q '"event":"driving"' /tmp/events || {
  cat /tmp/events
  exit 1
}
kill "$(process " control ")"
wait $starting || true
first=$(sed -n 's/^\([0-9]*\) .*"event":"driving".*/\1/p' /tmp/events)
# A run watches for a whole second that the robot stands still, looking every 20 ms, and announces itself for three seconds.
figure "start to the first tick, without standing still and beeping" $(((first - started) / 1000000 - 4000)) ms "<=" 150


read -r user kernel </tmp/split
per_tick=$(awk "BEGIN { printf \"%d\", ($after_cpu - $before_cpu) / 4 / (($after - $before) / 1e7) }")
figure "samples of control" $((user + kernel)) "in 8 s"
figure "of a tick in user code" $((per_tick * user / (user + kernel))) "instructions"
figure "of a tick in the kernel" $((per_tick * kernel / (user + kernel))) "instructions"
# On a brick the drivers answer from the kernel; here each of the five readings is a message to the simulator's process and back, most of
# the kernel's part. The goal for a brick is 50000; what is held here is that it gets no worse.
figure "the whole tick at 100 Hz, control alone" "$per_tick" instructions "<=" 130000
