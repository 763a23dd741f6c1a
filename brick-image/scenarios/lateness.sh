# shellcheck shell=dash
# How late ticks are at 50 Hz while another program eats the processor.
seconds=${1:-30}
brick_up
probe hog &
hog=$!
drive "$(mission map 50 "$seconds")"
arrive
kill $hog
brick_down
brick-figures run /tmp/run/run.mcap >/tmp/figures
figure "ticks beside a busy program" "$(field /tmp/figures ticks)" ticks
figure "late, the median" "$(field /tmp/figures late_p50_us)" us
figure "late, 99 of 100 at most" "$(field /tmp/figures late_p99_us)" us
figure "late, the latest" "$(field /tmp/figures late_max_us)" us "<" 20000
figure "missed deadlines" "$(field /tmp/figures missed)" ticks "==" 0
