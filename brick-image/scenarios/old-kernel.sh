# shellcheck shell=dash
# ev3dev's kernel is 4.14: no system call from number 398 on. Missions, service, link and menu run
# where they do not exist. pidfd_open came with 5.3, fstat64 is as old as ARM.
expect "this kernel has a call of a later one" probe call 434
refuse "under the filter it has not" probe enosys 398 probe call 434
expect "and has the older ones" probe enosys 398 probe call 197
brick_up
mkdir -p /tmp/old
printf '#!/bin/sh\nexec probe enosys 398 /usr/bin/onbrick.real "$@"\n' >/tmp/old/onbrick
mv /usr/bin/onbrick /usr/bin/onbrick.real
mv /tmp/old/onbrick /usr/bin/onbrick
chmod +x /usr/bin/onbrick
drive "$(mission map 50 5)"
arrive
onbrick devices --brick /tmp/brick >/dev/null
onbrick halt --brick /tmp/brick
probe seed
service_up /tmp/runs
expect "the service's link opens" wait_for 60 linked
drive_through "$(mission map 50 5)"
arrive
setsid onbrick menu --at-boot --config /tmp/config --brick /tmp/brick --screen /dev/fb0 </dev/tty1 \
  >/tmp/menu.log 2>&1 &
menu=$!
shows_missions() {
  brick-figures screen /dev/fb0 /tmp/screen.pgm | tr '\n' ' ' | grep -qF '[Missions'
}
expect "the menu draws" wait_for 30 shows_missions
kill -TERM "$menu"
cat /tmp/menu.log
service_down
brick_down
echo "ok: a mission, devices, halt, service, link and menu without a system call of a later kernel"
