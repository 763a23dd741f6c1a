# shellcheck shell=dash
# Right after power-on the kernel has no random numbers yet. A mission still drives, by itself and
# through the service, whose status says what the link waits for; the link comes when it can.
none() { [ "$(probe random)" != ready ]; }
expect "the kernel has no random numbers yet" none
brick_up
drive "$(mission map 50 3)"
expect "nor when the robot drives" none
arrive

service_up /tmp/runs
drive_through "$(mission map 50 3)"
brick-figures status /tmp/config/socket >/tmp/status
expect "nor when it drives through the service" none
expect "whose status says what the link waits for" \
  grep -q '"link":"waits for the kernel.s random numbers"' /tmp/status
refuse "which is not open" linked
arrive
probe seed
expect "with random numbers the link opens" wait_for 60 linked
# The link opens a moment before the service's next look at it.
says_that_it_is_ready() {
  brick-figures status /tmp/config/socket >/tmp/status
  grep -q '"link":"ready"' /tmp/status
}
expect "and the status says so" wait_for 60 says_that_it_is_ready
service_down
brick_down
