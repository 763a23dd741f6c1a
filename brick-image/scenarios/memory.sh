# shellcheck shell=dash
# What control, guard and service keep in memory together over a mission at 100 Hz that the service
# runs and records, with its link open: `memory 600` for the whole ten minutes, with a --disk of
# ext4 for the recording. The program's file, which they share, is counted once.
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
# Kilobytes: what each has for itself, all together, and what the one has of the program's file that
# has most of it: the guard locks all of it. The file counts as shared memory here, where files live
# in memory.
resident() {
  for folder in $(ours); do cat "$folder/status" 2>/dev/null || true; done |
    awk '/^VmRSS:/ { file = 0 } /^RssAnon:/ { own += $2 }
      /^RssFile:|^RssShmem:/ { file += $2; if (file > most) most = file }
      END { print own + 0, most + 0 }'
}

drive_through "$(mission map 100 "$seconds")"
each() {
  for folder in $(ours); do
    echo "$(tr '\0' ' ' <"$folder/cmdline" | cut -c1-40):" \
      "$(awk '/^Rss/ { printf "%s %s kB  ", $1, $2 }' "$folder/status")"
  done
}
started=$(probe now)
passed() { echo $((($(probe now) - started) / 1000000000)); }
peak=0 text=0 first_minute=0 minute=1
while [ "$(passed)" -lt $((seconds - 10)) ]; do
  sleep 5
  read -r now file <<END
$(resident)
END
  [ "$now" -le "$peak" ] || peak=$now
  [ "$file" -le "$text" ] || text=$file
  if [ "$(passed)" -le 60 ]; then first_minute=$peak; fi
  if [ "$(passed)" -ge $((60 * minute)) ]; then
    echo "after $minute min: $now kB and $file kB of the program's file"
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
figure "peak resident memory, all of them, their own" "$peak" kB "<=" 8192
figure "resident of the program's file, once" "$text" kB
figure "peak resident memory, all of them, with the program's file once" $((peak + text)) kB
# Of peaks, in pages of 4 kB: 12 to 20 kB were seen of one and the same program; supposedly by when
# the recorder waited for its disk.
figure "growth after the first minute" $((peak - first_minute)) kB "<=" 32
