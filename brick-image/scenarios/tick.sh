# shellcheck shell=dash
# What the whole tick costs at 100 Hz: control alone, by its own processor clock; by stage; and how soon the first tick is.
seconds=${1:-30}
brick_up

brick-figures stages /tmp/brick 10 >/tmp/stages
while IFS=: read -r ns stage; do
  figure "stage:$stage" $((ns / 4)) "instructions a tick"
done </tmp/stages

control=
started=$(probe now)
drive "$(mission map 100 "$seconds")"
first=$(sed -n 's/^\([0-9]*\) .*"event":"driving".*/\1/p' /tmp/events)
# Where it goes, and then, without being looked at, how much it is; start and end of the run are in neither.
sleep 2
probe split "$control" 8 >/tmp/split
before_cpu=$(probe cpu "$control")
before=$(probe now)
sleep $((seconds - 12))
after_cpu=$(probe cpu "$control")
after=$(probe now)
arrive
brick_down

read -r user kernel </tmp/split
per_tick=$(awk "BEGIN { printf \"%d\", ($after_cpu - $before_cpu) / 4 / (($after - $before) / 1e7) }")
figure "samples of control" $((user + kernel)) "in 8 s"
figure "of a tick in user code" $((per_tick * user / (user + kernel))) "instructions"
figure "of a tick in the kernel" $((per_tick * kernel / (user + kernel))) "instructions"
figure "the whole tick at 100 Hz, control alone" "$per_tick" instructions "<=" 50000
# A run first watches for a whole second that the robot stands still, looking every 20 ms.
figure "start to the first tick, without the second of watching" $(((first - started) / 1000000 - 1000)) ms "<=" 150
