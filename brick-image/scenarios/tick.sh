# What the whole tick costs at 100 Hz: control alone, by its own processor clock; by stage; and how soon the first tick is.
seconds=${1:-30}
brick_up
sed -e 's/^rate_hz = .*/rate_hz = 100/' -e "s/^time_limit_s = .*/time_limit_s = $seconds/" /etc/onbrick/missions/map.toml >/tmp/map.toml

brick-figures stages /tmp/brick 10 >/tmp/stages
while IFS=: read -r ns stage; do
  figure "stage: $stage" $((ns / 4)) "instructions a tick"
done </tmp/stages

onbrick --json run /tmp/map.toml --brick /tmp/brick --robot /etc/onbrick/robot.toml --out /tmp/run >/tmp/events &
run=$!
wait_for 60 grep -q '"event":"driving"' /tmp/events || { cat /tmp/events; exit 1; }
control=$(process "onbrick control")
# Where it goes, and then, without being looked at, how much it is; start and end of the run are in neither.
sleep 2
probe split "$control" 8 >/tmp/split
before_cpu=$(probe cpu "$control")
before=$(probe now)
sleep $((seconds - 12))
after_cpu=$(probe cpu "$control")
after=$(probe now)
wait $run || { cat /tmp/events; exit 1; }
brick_down

read -r user kernel </tmp/split
per_tick=$(awk "BEGIN { printf \"%d\", ($after_cpu - $before_cpu) / 4 / (($after - $before) / 1e7) }")
figure "samples in user code" "$(awk "BEGIN { printf \"%.0f\", 100 * $user / ($user + $kernel) }")" "% of $((user + kernel))"
figure "of it in user code" "$(awk "BEGIN { printf \"%.0f\", $per_tick * $user / ($user + $kernel) }")" "instructions a tick"
figure "of it in the kernel" "$(awk "BEGIN { printf \"%.0f\", $per_tick * $kernel / ($user + $kernel) }")" "instructions a tick"
figure "the whole tick at 100 Hz, control alone" "$per_tick" "instructions a tick" "<=" 50000
