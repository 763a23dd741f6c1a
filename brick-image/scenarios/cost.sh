# shellcheck shell=dash
# What a whole run takes of the processor while a simulated robot drives and maps, at 50 and at 100
# Hz: control with its recorder, guard and service, each alone and together; and each stage of a
# tick. Time counts instructions (`--exact`), 250 million a second, as an ARM926EJ-S has.
seconds=${1:-20}
brick_up

# A mission of a hundred states and fifty variables beside the shipped one.
for which in map large; do
  brick-figures stages /tmp/brick 10 $which >/tmp/stages
  sum=0
  while IFS=: read -r ns stage; do
    figure "stage, $which: $stage" $((ns / 4)) "instructions a tick"
    sum=$((sum + ns / 4))
  done </tmp/stages
  eval "tick_$which=$sum"
done
# shellcheck disable=SC2154  # eval sets them
more=$((100 * (tick_large - tick_map) / tick_map))
figure "a large mission's tick beside map's" $more "% more" "<=" 20

service_up /tmp/runs

# spent_ns: what each of the three has used since it began.
spent_ns() {
  # shellcheck disable=SC2154  # service_up sets it
  for pid in $control $guard $service; do probe cpu "$pid"; done
}

# share HZ NAME NS USER KERNEL: prints what a process takes, and adds the samples in user mode.
share() {
  instructions=$(($3 / 4 / ticks))
  in_user=$((instructions * $4 / ($4 + $5)))
  all_user=$((all_user + in_user)) all=$((all + instructions))
  figure "$1 Hz: $2, user mode" $in_user "instructions a tick"
  figure "$1 Hz: $2, kernel" $((instructions - in_user)) "instructions a tick"
}

# cost HZ [COMPARISON BOUND]: the bound is for the user mode of all three.
cost() {
  hz=$1
  shift
  drive_through "$(mission map "$hz" $((2 * seconds + 12)))"
  control=$(process "onbrick control ")
  guard=$(process "onbrick guard ")
  expect "control and guard are there" test -n "$control" -a -n "$guard"
  # How it is divided, and then, without samples being taken, how much it is; the run's start and
  # end are in neither.
  sleep 4
  # shellcheck disable=SC2086  # three numbers
  probe split "$seconds" $control $guard $service >/tmp/split
  spent_ns >/tmp/before
  began=$(probe now)
  sleep "$seconds"
  spent_ns >/tmp/after
  passed_ns=$(($(probe now) - began))
  arrive
  ticks=$((passed_ns / (1000000000 / hz))) all=0 all_user=0
  for name in control guard service; do
    read -r was && read -r is <&4 && read -r user kernel <&5
    share "$hz" $name $((is - was)) "$user" "$kernel"
  done </tmp/before 4</tmp/after 5</tmp/split
  figure "$hz Hz: all three, user mode" $all_user "instructions a tick" "$@"
  # On a brick the drivers answer from the kernel; here each reading is a FUSE message to the
  # simulator and back, most of this part.
  figure "$hz Hz: all three, kernel" $((all - all_user)) "instructions a tick"
  per_cent() { awk "BEGIN { printf \"%.2f\", $1 }"; }
  figure "$hz Hz: all three" "$(per_cent "$all * $hz / 2.5e6")" "% of the processor"
  figure "$hz Hz: left idle by them" "$(per_cent "100 - $all * $hz / 2.5e6")" "% of the processor"
  # The robot moved: what stands and sees the same each tick costs less.
  brick-figures run "$(find /tmp/runs -name run.mcap -newer /tmp/before)" >/tmp/figures
  expect "it was $hz Hz" test "$(field /tmp/figures ticks)" -gt $((hz * 2 * seconds))
  figure "$hz Hz: points of its map" "$(field /tmp/figures points)" points ">" 50
}

cost 50
cost 100 "<=" 120000
service_down
brick_down
