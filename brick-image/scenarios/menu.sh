# shellcheck shell=dash
# The menu on a kernel's frame buffer, with keys from a kernel's input device and a console behind
# it: walked through as a person would, ended in every way, and what it costs. `menu walk ends
# killed costs pairs` are its parts. What the screen showed is in /tmp/out, as pictures and as text.
[ $# -gt 0 ] || set -- walk ends killed costs pairs

# The brick is the simulated one, but for buttons and screen, which are this kernel's.
root_up() {
  brick_up
  mkdir -p /tmp/root/dev/input/by-path
  ln -s /tmp/brick/sys /tmp/root/sys
  ln -s /dev/fb0 /tmp/root/dev/fb0
  ln -s /tmp/brick/dev/input/by-path/platform-sound-event /tmp/root/dev/input/by-path/
  mkfifo /tmp/keys
  buttons_up
}

buttons_up() {
  probe buttons </tmp/keys 2>/tmp/buttons.log &
  buttons=$!
  exec 3>/tmp/keys
  wait_for 10 grep -q 'EV3 Brick Buttons' /proc/bus/input/devices || cat /tmp/buttons.log
  event=$(sed -n '/EV3 Brick Buttons/,/^$/s/.*\(event[0-9]*\).*/\1/p' /proc/bus/input/devices)
  ln -sf "/dev/input/$event" /tmp/root/dev/input/by-path/platform-gpio_keys-event
}

serve_up() {
  mkdir -p /tmp/config/missions
  cp /etc/onbrick/missions/map.toml /tmp/config/missions
  # Another that this robot can drive: the shipped one wants a touch sensor.
  cp /etc/onbrick/missions/map.toml /tmp/config/missions/bump.toml
  echo 'name = "wall"' >/tmp/config/missions/wall.toml
  cp /etc/onbrick/robot.toml /tmp/config/
  onbrick serve --brick /tmp/root --config /tmp/config >/tmp/serve.log 2>&1 &
  serve=$!
  wait_for 60 test -S /tmp/config/socket
}

# menu_up WORDS…: the menu on the console, in a process group of its own as under brickman; how long
# its first picture took is in /tmp/first.
menu_up() {
  setsid probe frame /dev/fb0 onbrick menu --config /tmp/config --brick /tmp/root "$@" </dev/tty1 \
    >/tmp/first 2>/tmp/menu.log || cat /tmp/menu.log
  menu=$(process "onbrick menu")
}

menu_down() {
  kill -TERM "$menu"
  wait_for 10 is_gone "$menu"
}

is_gone() { ! [ -e "/proc/$1" ]; }

# keys LETTERS: u d l r e b; a capital is held until a dot.
keys() { printf '%s' "$1" >&3; }

# sees PICTURE WORDS: whether a person can read them. The picture goes to /tmp/out under its name.
sees() {
  brick-figures screen /dev/fb0 "/tmp/out/$1.pgm" >"/tmp/out/$1.txt" &&
    tr '\n' ' ' <"/tmp/out/$1.txt" | grep -qF "$2"
}

shows() {
  looks=40
  until sees "$1" "$2" || [ $looks = 0 ]; do
    sleep 0.5
    looks=$((looks - 1))
  done
  if [ $looks -gt 0 ]; then
    echo "ok: the screen shows \"$2\""
    sed 's/^/    | /' "/tmp/out/$1.txt"
  else
    echo "FAILED: the screen does not show \"$2\""
    cat "/tmp/out/$1.txt"
    failures=$((failures + 1))
  fi
}

# Down until this is in view: what is longer than the screen scrolls.
down_to() {
  presses=20
  until sees down "$1" || [ $presses = 0 ]; do
    keys d
    # Until the key is typed and the picture drawn.
    sleep 0.5
    presses=$((presses - 1))
  done
}

# Pixel by pixel, but for the battery's voltage.
golden() { brick-figures screen /dev/fb0 "/tmp/out/$1.pgm" "$1" >/dev/null; }

motors() { cat /tmp/brick/sys/class/tacho-motor/*/state; }
still() { ! motors | grep -q running; }
turns() { motors | grep -q running; }
console_is() { [ "$(probe console /dev/tty1)" = "$1" ]; }
memory() { awk "/^$1:/ { print \$2 }" "/proc/$menu/status"; }
ended_by() { brick-figures run "$(newest)" | grep -q "\"ended\":\"[^\"]*$1"; }
# shellcheck disable=SC2012  # names of our own
newest() { ls -t /tmp/config/runs/*/run.mcap | head -n 1; }
# What a process takes while $1 s go by, instructions a second.
effort() {
  before=$(probe cpu "$menu")
  sleep "$1"
  after=$(probe cpu "$menu")
  echo $(((after - before) / 4 / $1))
}

walk() {
  expect "the console shows text" console_is text
  menu_up --at-boot
  figure "start to the first picture" $(($(cat /tmp/first) / 1000000)) ms "<=" 200
  shows missions "> bump"
  expect "the list is the golden picture, pixel by pixel" wait_for 5 golden missions
  expect "the console shows graphics" console_is graphics
  echo 'a line of the kernel or of another program' >/dev/tty1
  expect "and no text on the picture" golden missions
  figure "at rest" "$(effort 10)" "instructions a second" "<=" 5000000
  keys de
  shows mission "Start"
  expect "the mission's page is the golden picture" wait_for 5 golden mission
  keys e
  shows running "points"
  expect "and the motors turn" wait_for 20 turns
  figure "while a run is shown" "$(effort 10)" "instructions a second"
  keys r
  shows map "[Map"
  sleep 5
  before=$(md5sum </tmp/out/map.pgm)
  expect "the map grows" [ "$before" != "$(sees map Map && md5sum </tmp/out/map.pgm)" ]
  figure "while its map is shown" "$(effort 5)" "instructions a second"
  keys l
  shows running-on "STOP"
  keys e
  shows end "Done"
  expect "Enter has stopped the motors" still
  expect "and the recording says so" wait_for 10 ended_by "button"
  keys e
  shows run-map "[Run 1"
  keys b
  shows runs "1 map:"
  keys r
  shows ports "> in1 ev3-us"
  down_to "> outB"
  keys e
  shows port "Hold Up or Down"
  keys U
  expect "a motor turns while Up is held" wait_for 5 turns
  sleep 2
  expect "for as long" turns
  keys .
  expect "and no longer" wait_for 2 still
  keys bur
  shows set-up "Calibrate"
  keys r
  shows settings "Lights"
  down_to "link: "
  shows settings-link "link: "
  # Nine tenths of it are pages of the program's file, which the run's processes have as well.
  figure "resident memory of the menu, after all its pages and a map" "$(memory VmRSS)" kB "<=" 5120
  figure "of it its own" "$(memory RssAnon)" kB "<=" 1024
  kill -TERM "$serve"
  shows no-service "No service"
  serve_up
  shows settings-again "Lights"
  menu_down
}

# The menu's ends: what it must put back.
ends() {
  menu_up --at-boot
  for signal in TERM INT HUP; do
    kill -$signal "$menu"
    expect "SIG$signal ends it" wait_for 10 is_gone "$menu"
    expect "the console shows text after SIG$signal" console_is text
    menu_up --at-boot
    shows "after-$signal" "[Missions"
    expect "and graphics in the next menu" console_is graphics
  done
  kill "$buttons"
  expect "a menu whose buttons are gone ends" wait_for 10 is_gone "$menu"
  expect "with the console in text" console_is text
  cat /tmp/menu.log
  exec 3>&-
  buttons_up
  timeout 2 cat /dev/tty1 >/tmp/typed || true
  expect "what the buttons typed is in no shell" [ ! -s /tmp/typed ]
}

# Back, as brickman takes it: SIGKILL for the whole process group, and the console put back by
# brickman's own server.
killed() {
  menu_up
  shows under-brickman "> bump"
  keys de
  shows mission-under-brickman "Back also closes"
  keys e
  expect "a run of this menu's drives" wait_for 30 turns
  kill -KILL -"$(awk '{ print $5 }' "/proc/$menu/stat")"
  killed_at=$(probe now)
  expect "its motors are still" wait_for 5 still
  figure "from SIGKILL to motors that are still, at most" \
    $((($(probe now) - killed_at) / 1000000)) ms "<=" 2000
  expect "the run ended because the menu closed" wait_for 10 ended_by "menu"
  expect "no process of ours has put the console back" console_is graphics
  # The missions, or how the run ended where the service had not noted that yet; what the killed
  # menu left on the screen is neither. Lines are patterns of their own for grep.
  menu_up --at-boot
  shows after-kill '[Missions
[Done'
  menu_down
  expect "the next menu that ends does" console_is text
}

# through_service NAME: a mission of twelve seconds, and its recording in /tmp/NAME.
through_service() {
  sed -e 's/^time_limit_s = .*/time_limit_s = 12/' /etc/onbrick/missions/map.toml >/tmp/twelve.toml
  onbrick run /tmp/twelve.toml --config /tmp/config --brick /tmp/root --out "/tmp/$1" \
    >/tmp/run.log 2>&1 || cat /tmp/run.log
}

costs() {
  through_service costs
  brick-figures menu /tmp/costs/run.mcap /dev/fb0 >/tmp/menu-costs
  while IFS=: read -r ns of; do
    figure "cost:$of" $((ns / 4)) instructions
  done </tmp/menu-costs
}

# Ticks' lateness beside the menu that shows the map, and without it, in turns. The robot stands
# again where it stood at first. How far it has driven until now depends on how long this took; and
# wheels that are blocked by a wall cost the simulated brick so much that ticks are 12 ms late, with
# a menu or without.
back_to_the_start() {
  kill -TERM "$serve"
  wait "$serve" || true
  brick_down
  brick_up
  serve_up
}

pairs() {
  for pair in 1 2; do
    back_to_the_start
    through_service "without-$pair"
    menu_up --at-boot
    shows "pairs-$pair" "[Missions"
    through_service "with-$pair" &
    run=$!
    shows "pairs-run-$pair" "points"
    keys r
    wait $run
    menu_down
    for with in without with; do
      brick-figures run "/tmp/$with-$pair/run.mcap" >/tmp/figures
      for share in p50 p99 max; do
        figure "late $with the menu, pair $pair, $share" "$(field /tmp/figures late_${share}_us)" us
      done
      figure "missed deadlines $with the menu, pair $pair" "$(field /tmp/figures missed)" ticks \
        "==" 0
    done
  done
}

root_up
serve_up
for part in "$@"; do $part; done
kill -TERM "$serve"
brick_down
