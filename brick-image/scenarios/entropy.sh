# shellcheck shell=dash
# Right after power-on the kernel has no random numbers yet: a mission drives all the same.
expect "the kernel has no random numbers yet" [ "$(probe random)" != ready ]
brick_up
drive "$(mission map 50 3)"
expect "nor when the robot drives" [ "$(probe random)" != ready ]
arrive
brick_down
