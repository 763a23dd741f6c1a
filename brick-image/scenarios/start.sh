# shellcheck shell=dash
# How soon the first tick is: the process that drives, from its start on, over plain files with the simulated brick's texts, so that nobody
# waits for the simulator; the sensors' modes are right already. By design a run watches for five seconds that the robot and its gyro
# stand still, and announces itself meanwhile: that is a figure of its own, and the bound is for the rest.
brick_up
for node in /tmp/brick/sys/class/*/*; do
  plain=/tmp/plain/${node#/tmp/brick/}
  mkdir -p "$plain"
  for attribute in "$node"/*; do
    if [ -f "$attribute" ]; then cp "$attribute" "$plain/" 2>/dev/null || : >"$plain/${attribute##*/}"; fi
  done
done
brick_down
quick=$(mission map 100 20)

# measure NUMBER: one start; its lines are in /tmp/said, stamped ahead of everything else, so that each has the time at which it was said. The
# first empty one is the first tick's beat.
measure() {
  rm -f /tmp/said
  brick-figures job "$quick" /tmp/plain "/tmp/run-$1.mcap" >/tmp/job
  {
    probe now >/tmp/started
    exec onbrick -vv control
  } </tmp/job 2>&1 | probe fifo 60 probe stamp >/tmp/said &
  starting=$!
  if ! wait_for 30 grep -q '^[0-9]* $' /tmp/said; then
    cat /tmp/said
    return 1
  fi
  kill "$(process " control ")"
  wait $starting || true
}
# at WORDS: milliseconds after the start, with three digits, at which they were first said.
at() { awk -v began="$(cat /tmp/started)" -v words="$1" '$0 ~ words { printf "%.3f", ($1 - began) / 1e6; exit }' /tmp/said; }
less() { awk "BEGIN { printf \"%.1f\", $1 - $2 }"; }

# The first start reads the program's file for the first time, as after power-on; the second finds it in memory.
for start in 1 2; do
  measure $start
  bound=$(at "the robot is bound") announced=$(at "announced itself") driving=$(at '"driving"') beat=$(at '^[0-9]* $')
  figure "start $start: files read, robot bound" "$bound" ms
  figure "start $start: by design, standing still and announcing" "$(less "$announced" "$bound")" ms
  figure "start $start: recording begun" "$(less "$driving" "$announced")" ms
  figure "start $start: the first tick" "$(less "$beat" "$driving")" ms
  figure "start $start: start to the first tick, without standing still and announcing" "$(less "$(less "$beat" "$announced")" "-$bound")" ms "<=" 150
done
