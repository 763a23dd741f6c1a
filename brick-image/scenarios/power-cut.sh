# shellcheck shell=dash
# One link of a chain of power cuts, which tests/image/power-cut.sh makes: looks at what the last
# cut left on the disk, then drives until the next one. power-cut NUMBER LEAST: the last run must
# reach LEAST milliseconds; with `end` after it nothing is driven any more.
number=$1
least_ms=$2
mount -t ext4 /dev/vda /mnt
brick_up
if [ "$number" -gt 1 ]; then
  brick-figures run /mnt/run-$((number - 1))/run.mcap >/tmp/figures || {
    echo "FAILED: the recording cannot be opened"
    exit 1
  }
  synced_ms=$(field /tmp/figures last_synced_ms)
  figure "cut $((number - 1)): reached when last seen, less 1 s between two syncs and 0.5 s" \
    "$least_ms" ms
  figure "cut $((number - 1)): the recording, with each record's checksum, goes to" \
    "${synced_ms:-0}" ms ">=" "$least_ms"
  figure "cut $((number - 1)): damaged stretches" "$(field /tmp/figures damaged)" "" "==" 0
  echo "cut $((number - 1)): $(sed -n 's/.*"integrity":"\([^"]*\)".*/\1/p' /tmp/figures)"
  # No process of ours starts by itself: what a motor does after the next start is not ours.
  sleep 2
  for motor in /tmp/brick/sys/class/tacho-motor/motor*; do
    expect "after cut $((number - 1)): $(cat "$motor/address") is still" \
      [ -z "$(cat "$motor/state")" ]
  done
fi
if [ "${3:-}" != end ]; then
  onbrick --json run "$(mission map 50 600)" --brick /tmp/brick --out "/mnt/run-$number" 2>&1 |
    while read -r line; do
    case $line in
      *'"event":"status"'*)
        elapsed_ns=${line#*'"elapsed_ns":'}
        echo "at $((${elapsed_ns%%,*} / 1000000)) ms"
        ;;
      *'"error"'* | *'"refused"'*) echo "$line" ;;
    esac
  done
  echo "FAILED: the run ended before the power did"
  exit 1
fi
