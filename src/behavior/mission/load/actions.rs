//! The tables `do`, `on_entry` and `on_exit`: what a state asks of the actuators.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_4;
use std::ops::Range;

use super::signs::SIGNS;
use super::{Outputs, Reader};
use crate::behavior::expression::{Expression, Mistake};
use crate::behavior::mission::{DrivePlan, GoalPlan, MotionPlan, MotorPlan};
use crate::document::{Item, Section};
use crate::ev3dev::StopAction;
use crate::senses::{QUANTITIES, Role};
use crate::units::{counted, degrees, radians};

/// What can be asked in `do`.
pub(super) fn actions() -> Vec<&'static str> {
    let drives = DRIVES.iter().map(|(key, _)| *key);
    let of_motions = OF_MOTIONS.iter().map(|(key, _)| *key);
    drives.chain(of_motions).chain(["head_deg", "motor", "motor_deg"]).chain(SIGNS).collect()
}

/// A speed that the robot's file does not allow.
const TOO_FAST: &str = "this is faster than the robot's wheels may turn (`max_dps`)";
const MOTOR_TOO_FAST: &str = "this is faster than the motor may turn (`max_dps`)";

/// Keys that move the wheels; those of one row go together.
const DRIVES: [(&str, usize); 10] = [
    ("left_dps", 0),
    ("right_dps", 0),
    ("forward_mps", 1),
    ("turn_dps", 1),
    ("stop", 2),
    ("drive_m", 3),
    ("turn_deg", 4),
    ("arc", 5),
    ("goto", 6),
    ("explore_m", 7),
];

/// What people ask for in `do`, and how it is said.
const ELSEWHERE: [(&str, &str); 3] = [
    ("set", "it stands in a transition, in `on_entry` or in `on_exit`"),
    ("wait", TO_WAIT),
    ("wait_s", TO_WAIT),
];
const TO_WAIT: &str = "to wait, look at the time in `next`, as in `when = \"state_s > 2\"`";

/// Keys that go with some motions that end, and with which.
const OF_MOTIONS: [(&str, &[&str]); 4] = [
    ("face_deg", &["goto"]),
    ("keep_m", &["goto", "explore_m"]),
    ("speed_mps", &["drive_m", "arc", "goto", "explore_m"]),
    ("speed_dps", &["turn_deg", "goto", "explore_m"]),
];

/// No actuator is asked for more by a slip of the finger: degrees per second, metres per second.
const DPS: (f64, f64) = (-10_000.0, 10_000.0);
const MPS: (f64, f64) = (-10.0, 10.0);
const HEAD_DEG: (f64, f64) = (-720.0, 720.0);
/// How far a motion may go: metres, and degrees; ten turns are for dancing.
const WAY_M: (f64, f64) = (-100.0, 100.0);
const TURN_DEG: (f64, f64) = (-3600.0, 3600.0);
/// Where a named motor may turn to: a winch of a hundred turns.
const MOTOR_DEG: (f64, f64) = (-36_000.0, 36_000.0);
/// How fast it may be asked to be: a speed has no direction there.
const SPEED_MPS: (f64, f64) = (0.001, MPS.1);
const SPEED_DPS: (f64, f64) = (1.0, DPS.1);

/// How far from the start can be explored, metres: the map's grid reaches 5.
const EXPLORE_M: (f64, f64) = (0.1, 5.0);
/// How far a robot may keep from things, metres: less is no robot, more is no room.
const KEEP_M: (f64, f64) = (0.05, 0.45);

type Moves = BTreeMap<Role, Range<usize>>;

/// Warns of a turn by eighths of a circle to two digits, such as 1.57: few turns are so small.
fn looks_like_radians(item: &Item<'_>, turn_deg: &Expression) {
    let Some(turn) = turn_deg.in_a_run() else { return };
    let eighths = libm::round(turn / FRAC_PI_4);
    let is_near = (turn - eighths * FRAC_PI_4).abs() < 0.006;
    if is_near && turn.fract() != 0.0 && (1.0..=8.0).contains(&eighths.abs()) {
        item.warning(format!("a turn is in degrees, and {turn} looks like radians"))
            .hint(format!("in degrees it is {}", 45.0 * eighths));
    }
}

impl<'d> Reader<'_, 'd, '_> {
    /// The table `do`; notes in `moves` what is moved, and where.
    pub(super) fn actions(&mut self, table: &Section<'d>, moves: &mut Moves) -> Outputs {
        let known = actions();
        for item in table.items().iter().filter(|item| !known.contains(&item.key())) {
            match ELSEWHERE.iter().find(|(key, _)| *key == item.key()) {
                Some((key, hint)) => {
                    item.error_at_key(format!("`{key}` cannot be asked for in `do`")).hint(*hint);
                }
                None => table.unknown(item, &known),
            }
        }
        let drive = self.drive(table, moves);
        let head_deg = table.get("head_deg").and_then(|item| {
            self.moves(Role::Head, &item, moves);
            let head_deg = self.number(&item, HEAD_DEG)?;
            self.head_is_within_reach(&item, &head_deg);
            Some(head_deg)
        });
        let motors = self.motors(table, moves);
        Outputs { drive, head_deg, motors, ..self.telling(table, None) }
    }

    fn drive(&mut self, table: &Section<'d>, moves: &mut Moves) -> Option<DrivePlan> {
        let given: Vec<(Item<'d>, usize)> =
            DRIVES.iter().filter_map(|(key, row)| Some((table.get(key)?, *row))).collect();
        self.goes_with(table);
        let (first, row) = given.first()?;
        self.moves(Role::Wheels, first, moves);
        if let Some((other, _)) = given.iter().find(|(_, other)| other != row) {
            let (one, two) = (first.key(), other.key());
            other
                .error_at_key(format!("`{one}` and `{two}` both say what the wheels do"))
                .hint("leave one out");
            return None;
        }
        match first.key() {
            "left_dps" | "right_dps" => self.wheels(table, first),
            "forward_mps" | "turn_dps" => {
                let none = || Expression::constant(0.0);
                let forward_mps = self.optional(table, "forward_mps", MPS);
                let turn_dps = self.optional(table, "turn_dps", DPS);
                let forward_mps = forward_mps?.unwrap_or_else(none);
                let turn_dps = turn_dps?.unwrap_or_else(none);
                self.is_within_reach(first, &forward_mps, &turn_dps);
                Some(DrivePlan::Twist { forward_mps, turn_dps })
            }
            "stop" => {
                let stops = StopAction::ALL.iter().map(|stop| (stop.as_str(), *stop));
                first.word(&stops.collect::<Vec<_>>()).map(DrivePlan::Stop)
            }
            key => {
                let plan = self.motion(table, first).map(Box::new);
                let explores = (key == "explore_m").then(|| first.clone());
                let Some(over_map) = explores.or_else(|| table.get("keep_m")) else {
                    return Some(DrivePlan::Motion(plan?));
                };
                let moves_head = self.looks(table, first, &over_map, moves);
                Some(DrivePlan::Navigation { plan: plan?, moves_head })
            }
        }
    }

    /// Warns of a speed beyond what the robot's wheels may do: it would drive more slowly.
    fn is_within_reach(&self, item: &Item<'d>, forward_mps: &Expression, turn_dps: &Expression) {
        let Some(limits) = self.vocabulary.capabilities.limits else { return };
        let Some((forward, turn)) = forward_mps.in_a_run().zip(turn_dps.in_a_run()) else { return };
        let wheel_m_s = forward.abs() + radians(turn.abs()) * limits.half_track_m;
        if wheel_m_s > limits.max_m_s {
            let slower = limits.max_m_s / wheel_m_s;
            let drives = (forward != 0.0).then(|| format!("drives at {:.2} m/s", forward * slower));
            let turns =
                (turn != 0.0).then(|| format!("turns at {:.0} degrees a second", turn * slower));
            let done: Vec<String> = drives.into_iter().chain(turns).collect();
            item.warning(TOO_FAST).hint(format!("it {}", done.join(" and ")));
        }
    }

    /// Warns of a way that takes longer than the mission, as one in centimetres does.
    fn is_in_time(&self, item: &Item<'d>, plan: &MotionPlan) {
        let Some(limits) = self.vocabulary.capabilities.limits else { return };
        let both = |one: &Expression, other: &Expression| one.in_a_run().zip(other.in_a_run());
        let way_m = match &plan.goal {
            GoalPlan::Ahead { way_m } => way_m.in_a_run(),
            GoalPlan::Arc { radius_m, turn_deg } => {
                both(radius_m, turn_deg).map(|(radius_m, deg)| radius_m * radians(deg))
            }
            GoalPlan::Place { x_m, y_m, .. } => both(x_m, y_m).map(|(x, y)| libm::hypot(x, y)),
            GoalPlan::Turn { .. } | GoalPlan::Explore { .. } => None,
        };
        let speed_m_s = match &plan.speed_mps {
            Some(speed_mps) => speed_mps.in_a_run(),
            None => Some(limits.speed_m_s),
        };
        let Some((way_m, speed_m_s)) = way_m.zip(speed_m_s) else { return };
        let (speed_m_s, limit_s) = (speed_m_s.min(limits.max_m_s), self.time_limit_s());
        if way_m.abs() > speed_m_s * limit_s {
            let digits = if speed_m_s < 0.01 { 4 } else { 2 };
            item.warning(format!("the robot does not come so far in the mission's {limit_s} s"))
                .hint(format!(
                    "it drives at {speed_m_s:.digits$} m/s; a way is in metres (40 cm are 0.4)"
                ));
        }
    }

    /// The same for speeds of the wheels themselves.
    fn wheels_are_within_reach(&self, wheels: [(&Item<'d>, &Expression); 2]) {
        let Some(limits) = self.vocabulary.capabilities.limits else { return };
        let max_dps = limits.max_wheel_rad_s.to_degrees();
        let known = wheels.map(|(_, speed)| speed.in_a_run());
        let fastest = wheels.iter().zip(known).filter_map(|((item, _), dps)| Some((item, dps?)));
        let Some((item, dps)) = fastest.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())) else {
            return;
        };
        // What a file says in degrees comes back from radians.
        if dps.abs() <= max_dps * (1.0 + 1e-9) {
            return;
        }
        let turns = match known {
            [Some(left), Some(right)] => {
                let [left, right] = [left, right].map(|wheel| wheel * max_dps / dps.abs());
                format!("they turn at {left:.0} and {right:.0} degrees a second")
            }
            _ => format!("none turns faster than {max_dps:.0} degrees a second"),
        };
        item.warning(TOO_FAST).hint(turns);
    }

    /// Warns of a place that the head does not turn to: it stops before it.
    fn head_is_within_reach(&self, item: &Item<'d>, head_deg: &Expression) {
        let Some(limits) = self.vocabulary.capabilities.limits else { return };
        let most_deg = limits.head_rad.to_degrees();
        // A robot without a head has a finding of its own.
        let has_head = self.vocabulary.capabilities.has(Role::Head);
        let beyond = |deg: f64| deg.abs() > most_deg * (1.0 + 1e-9);
        if has_head && head_deg.in_a_run().is_some_and(beyond) {
            item.warning("the robot's head does not turn that far (`limit_deg`)")
                .hint(format!("it turns {most_deg:.0} degrees to each side"));
        }
    }

    /// Keys of motions belong to a motion of their kind.
    fn goes_with(&self, table: &Section<'d>) {
        for (key, motions) in OF_MOTIONS {
            let Some(item) = table.get(key) else { continue };
            if !motions.iter().any(|motion| table.get(motion).is_some()) {
                let motions = motions.iter().map(|motion| format!("`{motion}`"));
                let motions = motions.collect::<Vec<_>>().join(" or ");
                let speeds =
                    "`forward_mps` and `turn_dps` are speeds of a robot that drives on and on";
                let hint = if key.starts_with("speed_") { speeds } else { "" };
                item.error_at_key(format!("`{key}` goes together with {motions}")).hint(hint);
            }
        }
    }

    /// A motion that ends.
    fn motion(&mut self, table: &Section<'d>, item: &Item<'d>) -> Option<MotionPlan> {
        // Its numbers are taken once, so nothing in them can remember from tick to tick.
        let pids = self.vocabulary.pids.take();
        let goal = self.goal(table, item);
        let keep_m = self.optional(table, "keep_m", KEEP_M);
        let [speed_mps, speed_dps] = self.speeds(table);
        self.vocabulary.pids = pids;
        let plan = MotionPlan {
            goal: goal?,
            keep_m: keep_m?,
            speed_mps: speed_mps?,
            speed_dps: speed_dps?,
        };
        self.is_in_time(item, &plan);
        Some(plan)
    }

    /// A motion over the map looks where it drives, with the head where there is one: true then.
    ///
    /// - `over_map`: the key that takes the map.
    fn looks(
        &mut self,
        table: &Section<'d>,
        item: &Item<'d>,
        over_map: &Item<'d>,
        moves: &mut Moves,
    ) -> bool {
        self.moves(Role::Range, over_map, &mut Moves::new());
        let moves_head = self.vocabulary.capabilities.has(Role::Head);
        if moves_head {
            self.moves(Role::Head, item, moves);
            if let Some(head) = table.get("head_deg") {
                head.error_at_key(format!("`{}` moves the head itself", item.key()))
                    .hint("leave `head_deg` out");
            }
        }
        moves_head
    }

    fn goal(&mut self, table: &Section<'d>, item: &Item<'d>) -> Option<GoalPlan> {
        match item.key() {
            "drive_m" => Some(GoalPlan::Ahead { way_m: self.number(item, WAY_M)? }),
            "turn_deg" => {
                let turn_deg = self.number(item, TURN_DEG)?;
                looks_like_radians(item, &turn_deg);
                Some(GoalPlan::Turn { turn_deg })
            }
            "explore_m" => {
                if !self.vocabulary.capabilities.has(Role::Gyro) {
                    item.warning("without a gyro the heading is the wheels' alone").hint(
                        "plug in a gyro and name it under `[gyro]`: the map turns as wheels slip",
                    );
                }
                Some(GoalPlan::Explore { within_m: self.number(item, EXPLORE_M)? })
            }
            "arc" => {
                let arc = item.section()?;
                arc.allow(&["radius_m", "turn_deg"]);
                let radius_m = arc.require("radius_m").and_then(|item| self.number(&item, WAY_M));
                let turn_deg =
                    arc.require("turn_deg").and_then(|item| self.number(&item, TURN_DEG));
                Some(GoalPlan::Arc { radius_m: radius_m?, turn_deg: turn_deg? })
            }
            _ => {
                let list = item.list()?;
                if list.iter().any(Item::is_list) {
                    item.error("`goto` is one place, and this has several")
                        .hint("make a state for each, with `done` between them");
                    return None;
                }
                let [x, y] = list.as_slice() else {
                    item.error(format!(
                        "`goto` is a place, and this has {}",
                        counted(list.len(), "number")
                    ))
                    .hint("write x and y in metres, as in `goto = [0.8, -0.2]`");
                    return None;
                };
                let (x_m, y_m) = (self.number(x, WAY_M), self.number(y, WAY_M));
                let face_deg = self.optional(table, "face_deg", TURN_DEG);
                Some(GoalPlan::Place { x_m: x_m?, y_m: y_m?, face_deg: face_deg? })
            }
        }
    }

    /// How fast a motion is, ahead and round.
    #[expect(clippy::option_option, reason = "absent and wrong are different")]
    fn speeds(&mut self, table: &Section<'d>) -> [Option<Option<Expression>>; 2] {
        let speed_mps = self.optional(table, "speed_mps", SPEED_MPS);
        let speed_dps = self.optional(table, "speed_dps", SPEED_DPS);
        let none = Expression::constant(0.0);
        if let (Some(item), Some(Some(speed))) = (table.get("speed_mps"), &speed_mps) {
            self.is_within_reach(&item, speed, &none);
        }
        if let (Some(item), Some(Some(speed))) = (table.get("speed_dps"), &speed_dps) {
            self.is_within_reach(&item, &none, speed);
        }
        [speed_mps, speed_dps]
    }

    /// A number that may be left out; `None` where it is wrong.
    #[expect(clippy::option_option, reason = "absent and wrong are different")]
    fn optional(
        &mut self,
        table: &Section<'d>,
        key: &str,
        range: (f64, f64),
    ) -> Option<Option<Expression>> {
        table.value_or(key, None, |item| self.number(item, range).map(Some))
    }

    /// The speeds of the two wheels, which go together.
    fn wheels(&mut self, table: &Section<'d>, first: &Item<'d>) -> Option<DrivePlan> {
        let (Some(left), Some(right)) = (table.get("left_dps"), table.get("right_dps")) else {
            let missing = if first.key() == "left_dps" { "right_dps" } else { "left_dps" };
            first
                .error_at_key(format!("`{}` goes together with `{missing}`", first.key()))
                .hint(format!("`{missing} = 0` keeps that wheel still"));
            return None;
        };
        let (left_dps, right_dps) = (self.number(&left, DPS), self.number(&right, DPS));
        let (left_dps, right_dps) = (left_dps?, right_dps?);
        self.wheels_are_within_reach([(&left, &left_dps), (&right, &right_dps)]);
        Some(DrivePlan::Wheels { left_dps, right_dps })
    }

    /// What the named motors do, one by one.
    fn motors(&mut self, table: &Section<'d>, moves: &mut Moves) -> Vec<MotorPlan> {
        let mut motors: Vec<MotorPlan> = Vec::new();
        for key in ["motor", "motor_deg"] {
            for item in &table.items_of(key) {
                let Some(place) = self.motor(item, moves) else { continue };
                let at = motors.iter().position(|motor| motor.place == place);
                let at = at.unwrap_or_else(|| {
                    motors.push(MotorPlan { place, dps: None, to_deg: None });
                    motors.len() - 1
                });
                if key == "motor" {
                    motors[at].dps = self.motor_speed(item, place);
                } else {
                    // As those of every motion that ends, it is taken once.
                    let pids = self.vocabulary.pids.take();
                    motors[at].to_deg = self.number(item, MOTOR_DEG);
                    self.vocabulary.pids = pids;
                }
            }
        }
        motors
    }

    /// The place of a named motor, which is moved.
    fn motor(&mut self, item: &Item<'d>, moves: &mut Moves) -> Option<u8> {
        match self.vocabulary.motors.place(item.key()) {
            Ok(place) => {
                self.moves(Role::Motor(place), item, moves);
                Some(place)
            }
            Err(mistake) => {
                let hint = self.vocabulary.motors.hint(item.key());
                item.error_at_key(mistake.to_string()).hint(hint);
                None
            }
        }
    }

    fn motor_speed(&mut self, item: &Item<'d>, place: u8) -> Option<Expression> {
        let dps = self.number(item, DPS)?;
        let motors = self.vocabulary.capabilities.motors.as_ref();
        let motor = motors.and_then(|motors| motors.get(usize::from(place)));
        let max_dps = motor.map_or(f64::INFINITY, |(_, max_rad_s)| degrees(*max_rad_s));
        if dps.in_a_run().is_some_and(|dps| dps.abs() > max_dps * (1.0 + 1e-9)) {
            item.warning(MOTOR_TOO_FAST).hint(format!("it turns at {max_dps:.0} degrees a second"));
        }
        Some(dps)
    }

    /// Notes that a part is moved; a finding where the robot does not have it.
    fn moves(&mut self, role: Role, item: &Item<'d>, moves: &mut Moves) {
        moves.entry(role).or_insert_with(|| item.key_place());
        // What moves is sensed as well: the head, a named motor. Wheels always are.
        let sensed =
            QUANTITIES.iter().filter(|quantity| quantity.role == role && role != Role::Wheels);
        self.uses.extend(sensed.map(|quantity| (quantity.channel, item.key_place())));
        if !self.vocabulary.capabilities.has(role) && self.absent.insert(role.what()) {
            let (mistake, hint) = Mistake::no_part(item.key(), role);
            item.error_at_key(mistake.to_string()).hint(hint);
        }
    }
}
