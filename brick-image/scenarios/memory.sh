# shellcheck shell=dash
# What control and its like keep in memory over a mission at 100 Hz, without text, which is shared: memory 600 for the whole ten minutes.
seconds=${1:-120}
brick_up
# Kilobytes that all of them have resident and do not share.
resident() {
  kb=0
  for folder in /proc/[0-9]*; do
    case $(tr '\0' ' ' <"$folder/cmdline" 2>/dev/null) in
      onbrick\ * | /usr/bin/onbrick\ *)
        own=$(awk '/^Rss(Anon|Shmem):/ { kb += $2 } END { print kb + 0 }' "$folder/status" 2>/dev/null || echo 0)
        kb=$((kb + own))
        ;;
    esac
  done
  echo $kb
}
drive "$(mission map 100 "$seconds")"
peak=0 first_minute=0 passed=0
while [ $passed -lt $((seconds - 5)) ]; do
  sleep 5
  passed=$((passed + 5))
  now=$(resident)
  [ "$now" -le "$peak" ] || peak=$now
  if [ $passed -le 60 ]; then first_minute=$peak; fi
done
for folder in /proc/[0-9]*; do
  case $(tr '\0' ' ' <"$folder/cmdline") in
    onbrick\ * | /usr/bin/onbrick\ *)
      echo "$(tr '\0' ' ' <"$folder/cmdline" | cut -c1-40): $(awk '/^Rss/ { printf "%s %s kB  ", $1, $2 }' "$folder/status")"
      ;;
  esac
done
arrive
brick_down
figure "peak resident memory, all processes, without shared text" "$peak" kB "<=" 8192
figure "growth after the first minute" $((peak - first_minute)) kB "<=" 64
