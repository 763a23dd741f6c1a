# shellcheck shell=dash
# How soon the first tick is, over plain files with the simulated brick's texts, so that nobody waits for the simulator; modes are right already.
brick_up
mkdir -p /tmp/plain/sys
cp -rL /tmp/brick/sys/class /tmp/plain/sys/ 2>/dev/null || true
brick_down
quick=$(mission map 100 20)
started=$(probe now)
(onbrick --json run "$quick" --brick /tmp/plain --robot /etc/onbrick/robot.toml --out /tmp/run 2>&1 || true) | probe stamp >/tmp/events &
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
