//! Writing missions: the language by examples.
//!
//! A mission says what the robot does. It is a TOML file of *machines*; a machine is always in one
//! of its *states*; a state says what is done (`do`) and when another state follows (`next`). Each
//! example on this page is a whole mission: copy it into a file, `onbrick check FILE`, and
//! `onbrick run FILE --sim open`. `onbrick new mission FILE` writes one with all keys explained,
//! `onbrick new mission FILE --from map` a copy of a shipped one.
//!
//! The keys and rules are listed at [`behavior::mission`](crate::behavior::mission), the language
//! of conditions and numbers at [`behavior::expression`](crate::behavior::expression), what the
//! robot senses at [`senses`](crate::senses). Distances are in metres, times in seconds, angles in
//! degrees; to the left is positive.
//!
//! # Drive a way, turn an angle
//!
//! A motion has an end, and `done` says when it is there. A machine begins in the state that stands
//! first, unless `start` names another, and has come to its end in the state that `final` names.
//! One state needs no `next`: then the mission ends with its time.
//!
//! ```toml
//! name = "there"
//! [machine.drive]
//! final = "end"
//! [machine.drive.state.ahead]
//! do = { drive_m = 0.5 }
//! next = [{ when = "done", go = "turn" }]
//! [machine.drive.state.turn]
//! do = { turn_deg = 180, speed_dps = 60 }
//! next = [{ when = "done", go = "end" }]
//! [machine.drive.state.end]
//! ```
//!
//! `drive_m` with a minus drives backwards, `turn_deg` with a minus turns right.
//!
//! # Along a circle
//!
//! ```toml
//! name = "bend"
//! [machine.drive]
//! final = "end"
//! [machine.drive.state.bend]
//! do = { arc = { radius_m = 0.3, turn_deg = 90 }, speed_mps = 0.1 }
//! next = [{ when = "done", go = "end" }]
//! [machine.drive.state.end]
//! ```
//!
//! # Go to a place
//!
//! Places are where the run's own coordinates have them: `onbrick run --pose 0,0,0` says where the
//! robot stands at the start, and its x points ahead then.
//!
//! ```toml
//! name = "visit"
//! [machine.drive]
//! final = "end"
//! [machine.drive.state.go]
//! do = { goto = [0.8, -0.2], face_deg = 90 }
//! next = [{ when = "done", go = "end" }]
//! [machine.drive.state.end]
//! on_entry = { say = "at {x_m:.2}, {y_m:.2}", beep = "ok" }
//! ```
//!
//! # Explore, and come home
//!
//! With `explore_m` the robot drives where its map is not known yet, and looks round, until nothing
//! is left that it can reach. A `goto` with `keep_m` finds its way over that map and stays so far
//! from what it shows. It goes through what is not known yet, too, and looks as it comes there. The
//! map reaches 5 m to each side of the start: to a place beyond it the robot drives straight from
//! the map's edge, and stops before what it sees. A `goto` to a place that cannot be reached is
//! `done` without it when every way was tried, which can take as long as exploring:
//! `distance_m(x, y)` tells how far it is, and a condition on `state_s` ends it sooner. Both take a
//! range sensor and move the head, too; where the sensor is fixed, the robot turns round to look. A
//! pressed bumper makes the robot back off and go round. A variable may begin with an expression:
//! here with where the robot is at the start. The shipped mission `explore` is this one with ways
//! out for wheels that are blocked.
//!
//! ```toml
//! name = "round-trip"
//! time_limit_s = 300
//! [variables]
//! home_x = "x_m"
//! home_y = "y_m"
//! [machine.drive]
//! final = "home"
//! [machine.drive.state.explore]
//! do = { explore_m = 3 }
//! next = [{ when = "done or time_s > 240", go = "return" }]
//! [machine.drive.state.return]
//! do = { goto = ["home_x", "home_y"], keep_m = 0.15 }
//! next = [{ when = "done", go = "home" }]
//! [machine.drive.state.home]
//! ```
//!
//! # Drive until something happens
//!
//! Speeds without an end: the next state comes by a condition. The first condition that holds is
//! taken.
//!
//! ```toml
//! name = "until"
//! time_limit_s = 30
//! [machine.drive.state.ahead]
//! do = { forward_mps = 0.1 }
//! next = [{ when = "range_m < 0.25 or touch", go = "away" }]
//! [machine.drive.state.away]
//! do = { turn_dps = 45 }
//! next = [{ when = "state_turn_deg > 90 or state_s > 5", go = "ahead" }]
//! ```
//!
//! # Steer by what is sensed
//!
//! A number may be an expression in quotes; it is worked out in every tick.
//!
//! ```toml
//! name = "line"
//! [machine.drive.state.follow]
//! do = { forward_mps = 0.06, turn_dps = "2.5 * (35 - reflect_pct)" }
//! ```
//!
//! A controller that remembers is `pid(error, kp, ki, kd)`:
//!
//! ```toml
//! name = "keep-off"
//! [machine.drive.state.keep]
//! do = { forward_mps = "clamp(pid(range_m - 0.3, 0.8, 0.1, 0), -0.1, 0.1)" }
//! ```
//!
//! # Count and remember
//!
//! `[numbers]` have names and stay, `[variables]` change: `set`, in a transition or on entry.
//!
//! ```toml
//! name = "square"
//! [numbers]
//! side_m = 0.4
//! [variables]
//! sides = 0
//! [machine.drive]
//! final = "end"
//! [machine.drive.state.side]
//! do = { drive_m = "side_m" }
//! next = [{ when = "done", set = { sides = "sides + 1" }, go = "corner" }]
//! [machine.drive.state.corner]
//! do = { turn_deg = 90 }
//! next = [{ when = "done and sides == 4", go = "end" }, { when = "done", go = "side" }]
//! [machine.drive.state.end]
//! ```
//!
//! # In every state
//!
//! `always` is looked at before a state's own conditions, but in the final state.
//!
//! ```toml
//! name = "watch-out"
//! [machine.drive]
//! final = "end"
//! always = [{ when = "button_up or battery_v < 6", go = "end" }]
//! [machine.drive.state.ahead]
//! do = { drive_m = 0.3 }
//! next = [{ when = "done", go = "back" }]
//! [machine.drive.state.back]
//! do = { drive_m = -0.3 }
//! next = [{ when = "done", go = "ahead" }]
//! [machine.drive.state.end]
//! ```
//!
//! # Two things at the same time
//!
//! Machines work side by side and see each other's states and the same variables. Wheels, head and
//! each motor belong to one of them. Here one drives as the sub-machine `wander` does, of which
//! more below, and the other one counts what lies under its way ahead.
//!
//! ```toml
//! name = "search"
//! time_limit_s = 60
//! finish = "any"
//! [variables]
//! red_found = 0
//! [machine.drive.state.about]
//! use = "wander"
//! [machine.count]
//! final = "enough"
//! [machine.count.state.look]
//! next = [{ when = "colour == red and drive.state == about.ahead", go = "found" }]
//! [machine.count.state.found]
//! on_entry = { set = { red_found = "red_found + 1" }, beep = "beep" }
//! next = [
//!   { when = "red_found == 4", go = "enough" },
//!   { when = "colour != red", go = "look" },
//! ]
//! [machine.count.state.enough]
//! on_entry = { say = "found {red_found}" }
//! ```
//!
//! # Pieces to put together
//!
//! A state may `use` a machine in place of `do`: a *sub-machine*, of the same file, of a file
//! beside it that is called like it, or one that comes with the program. `done` is true when it is
//! in its final state; `with` says what its variables begin with.
//!
//! ```toml
//! name = "to-the-open"
//! time_limit_s = 60
//! [machine.drive]
//! always = [{ when = "touch", go = "back" }]
//! [machine.drive.state.look]
//! use = "look-round"
//! next = [{ when = "done", go = "go" }]
//! [machine.drive.state.go]
//! use = "hop"
//! with = { angle_deg = "look.farthest_deg", way_m = "min(0.5, look.farthest_m - 0.3)" }
//! next = [{ when = "done", go = "look" }]
//! [machine.drive.state.back]
//! do = { drive_m = -0.2 }
//! next = [{ when = "done or state_s > 4", go = "look" }]
//!
//! [submachine.hop]
//! final = "there"
//! [submachine.hop.variables]
//! angle_deg = 0
//! way_m = 0.3
//! [submachine.hop.state.turn]
//! do = { turn_deg = "angle_deg" }
//! next = [{ when = "done", go = "drive" }]
//! [submachine.hop.state.drive]
//! do = { drive_m = "way_m" }
//! next = [{ when = "done or range_m < 0.15", go = "there" }]
//! [submachine.hop.state.there]
//! ```
//!
//! These come with the program; `onbrick new submachine FILE --from NAME` writes one to be changed.
//!
//! | name | what it does | its variables |
//! |---|---|---|
//! | `look-round` | turns the head from side to side | `from_deg`, `to_deg`, `step_deg`; afterwards `nearest_m`, `nearest_deg`, `farthest_m`, `farthest_deg` |
//! | `follow-wall` | follows a wall on the right until there is none any more | `keep_m`, `lost_m`, `speed_mps` |
//! | `wander` | drives about, away from what is near, without an end | `near_m`, `speed_mps` |
//! | `come-home` | drives to a place, past what the map shows | `to_x`, `to_y`, `to_deg`, `keep_m` |
//!
//! # Look round
//!
//! The head's way has an end, too.
//!
//! ```toml
//! name = "look"
//! [machine.look.state.left]
//! do = { head_deg = 80 }
//! next = [{ when = "done", go = "right" }]
//! [machine.look.state.right]
//! do = { head_deg = -80 }
//! next = [{ when = "done", go = "left" }]
//! ```
//!
//! # Tell
//!
//! Lights, sounds, words. A text has up to four lines; `{…}` shows a value, `:.2` with two digits.
//!
//! ```toml
//! name = "tell"
//! [machine.tell]
//! final = "end"
//! [machine.tell.state.sing]
//! do = { tune = "C4/4 D4/4 E4/4 C4/4", tempo_bpm = 160, led = "orange" }
//! next = [{ when = "done", go = "show" }]
//! [machine.tell.state.show]
//! do = { say = "range\n{range_m:.2} m", tone_hz = "200 + 400 * clamp(range_m, 0, 2)" }
//! next = [{ when = "state_s > 3", go = "end" }]
//! [machine.tell.state.end]
//! on_entry = { beep = "ok", led = "green" }
//! ```
//!
//! # When something goes wrong
//!
//! `on_stall` names the state for blocked wheels; a sub-machine may have its own, which holds while
//! it is used, as those of `wander` and `come-home` do. `on_lost = "pause"` waits for an unplugged
//! sensor. `time_limit_s` ends every run and stops the motors.
//!
//! ```toml
//! name = "careful"
//! time_limit_s = 60
//! on_lost = "pause"
//! on_stall = "back"
//! [machine.drive.state.ahead]
//! do = { forward_mps = 0.1 }
//! next = [{ when = "range_m < 0.2", go = "back" }]
//! [machine.drive.state.back]
//! do = { drive_m = -0.1 }
//! next = [{ when = "done or state_s > 3", go = "turn" }]
//! [machine.drive.state.turn]
//! do = { turn_deg = 90 }
//! next = [{ when = "done or state_s > 4", go = "ahead" }]
//! ```
//!
//! # From other languages
//!
//! | | Pybricks | python-ev3dev2 | LEGO's blocks | here |
//! |---|---|---|---|---|
//! | half a metre ahead | `base.straight(500)` | `mdiff.on_for_distance(30, 500)` | Move Steering, on for rotations | `drive_m = 0.5` |
//! | a quarter to the right | `base.turn(90)` | `mdiff.turn_right(30, 90)` | Move Tank, on for degrees | `turn_deg = -90` |
//! | a bend | `base.arc(300, angle=90)` | `mdiff.on_arc_right(30, 300, way_mm)` | Move Steering with steering | `arc = { radius_m = 0.3, turn_deg = -90 }` |
//! | with the gyro | none on the EV3 | `mdiff.gyro = GyroSensor()`, `mdiff.turn_right(30, 90, use_gyro=True)` | none | a `[gyro]` in `robot.toml` |
//! | to a place | `base.move_by(800, -200)`, from where it is | `mdiff.odometry_start(0)`, `mdiff.on_to_coordinates(30, 800, -200)` | none | `goto = [0.8, -0.2]` |
//! | explore a room | none | none | none | `explore_m = 5` |
//! | drive on and on | `base.drive(100, 0)` | `mdiff.on(30, 30)` | Move Steering, on | `forward_mps = 0.1` |
//! | wait for a sensor | `while not touch.pressed(): wait(10)` | `touch.wait_for_pressed()` | Wait, touch sensor | `when = "touch"` |
//! | a variable | `n = n + 1` | `n = n + 1` | Variable, Math | `set = { n = "n + 1" }` |
//! | four times | `for i in range(4):` | `for i in range(4):` | Loop, count | a variable and `when = "n == 4"` |
//! | a piece with a name | `def hop():` | `def hop():` | My Block | `[submachine.hop]` and `use = "hop"` |
//! | at the same time | `await multitask(a(), b())` | `threading.Thread` | a second start block | a second `[machine.…]` |
//! | a colour | `sensor.color() == Color.RED` | `sensor.color == 5` | Switch, colour | `when = "colour == red"` |
//! | a tune | `ev3.speaker.play_notes(["C4/4"])` | `sound.play_song([("C4", "q")])` | Sound, play note | `tune = "C4/4"` |
//! | show a value | `ev3.screen.print(n)` | `print(n)` | Display, text | `say = "{n}"` |
//!
//! Pybricks is version 4, with a firmware of its own; its version 2, for ev3dev, has no `arc`,
//! `move_by` and `multitask`. LEGO's blocks are those of EV3 Lab. Pybricks, LEGO's blocks and
//! `turn_degrees` of python-ev3dev2 turn to the right for a positive angle; here it is the left, as
//! in mathematics and ROS. In coordinates y is to the left everywhere.
//!
//! # How long a mission is
//!
//! The same tasks here and as programs for Pybricks 2.0, which stand in `tests/data/pybricks`:
//! lines that are neither empty nor a comment, without what either side takes from its library, as
//! `DriveBase` there and the sub-machines here. Which motors and sensors there are is said in a
//! Pybricks program, too, in some ten lines; here it is in `robot.toml`. The programs ran on a
//! stand-in, not on a brick; with `multitask` of version 4 they would be shorter.
//!
//! | task | here | Pybricks |
//! |---|---|---|
//! | follow a line | 3 | 9 |
//! | to a place | 8 | 27 |
//! | count colours | 18 | 39 |
//! | there and back | 21 | 53 |
