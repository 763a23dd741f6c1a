# shellcheck shell=dash
# What the whole tick costs at 100 Hz: control alone, by its own processor clock; and by stage.
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
brick_down

read -r user kernel </tmp/split
per_tick=$(awk "BEGIN { printf \"%d\", ($after_cpu - $before_cpu) / 4 / (($after - $before) / 1e7) }")
figure "samples of control" $((user + kernel)) "in 8 s"
figure "of a tick in user code" $((per_tick * user / (user + kernel))) "instructions"
figure "of a tick in the kernel" $((per_tick * kernel / (user + kernel))) "instructions"
# On a brick the drivers answer from the kernel; here each reading, and each look whether a motor is still ours, is a message to the
# simulator's process and back, most of the kernel's part. The goal for a brick is 50000; what is held here is that it gets no worse.
figure "the whole tick at 100 Hz, control alone" "$per_tick" instructions "<=" 135000
