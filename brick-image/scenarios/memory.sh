# shellcheck shell=dash
# What control, guard and service keep in memory together over a mission at 100 Hz that the service runs and records, with its link open:
# `memory 600` for the whole ten minutes, with a --disk of ext4 for the recording. Text, which is shared, is not counted.
seconds=${1:-120}
brick_up
runs=/tmp/runs
if [ -e /dev/vda ]; then
  mount -t ext4 /dev/vda /mnt
  runs=/mnt/runs
fi
# As on a brick that has been on for a while: the link's keys want random numbers.
probe seed
service_up "$runs"
wait_for 60 linked || {
  cat /tmp/serve.log
  echo "FAILED: the service's link did not open"
  exit 1
}

ours() {
  for folder in /proc/[0-9]*; do
    case $(tr '\0' ' ' <"$folder/cmdline" 2>/dev/null) in
      *onbrick\ serve\ * | *onbrick\ guard\ * | *onbrick\ control\ *) echo "$folder" ;;
    esac
  done
}
# Kilobytes that all of them have resident and do not share. Text counts as shared memory here, where files live in memory.
resident() {
  kb=0
  for folder in $(ours); do
    own=$(awk '/^RssAnon:/ { kb += $2 } END { print kb + 0 }' "$folder/status" 2>/dev/null || echo 0)
    kb=$((kb + own))
  done
  echo $kb
}

drive_through "$(mission map 100 "$seconds")"
each() {
  for folder in $(ours); do
    echo "$(tr '\0' ' ' <"$folder/cmdline" | cut -c1-40): $(awk '/^Rss/ { printf "%s %s kB  ", $1, $2 }' "$folder/status")"
  done
}
started=$(probe now)
passed() { echo $((($(probe now) - started) / 1000000000)); }
peak=0 first_minute=0 minute=1
while [ "$(passed)" -lt $((seconds - 10)) ]; do
  sleep 5
  now=$(resident)
  [ "$now" -le "$peak" ] || peak=$now
  if [ "$(passed)" -le 60 ]; then first_minute=$peak; fi
  if [ "$(passed)" -ge $((60 * minute)) ]; then
    echo "after $minute min: $now kB"
    each
    minute=$((minute + 1))
  fi
done
processes=$(ours | wc -l)
each
arrive
echo "the recording has $(du -k "$runs" | tail -n 1 | cut -f1) kB"
service_down
brick_down
figure "processes that were looked at" "$processes" "(service, guard, control)" "==" 3
figure "peak resident memory, all of them, without shared text" "$peak" kB "<=" 8192
figure "growth after the first minute" $((peak - first_minute)) kB "<=" 16
