//! Plans over maps as drawings, and over any map.

use super::*;
use crate::mapping::{Estimate, MapPoint, Range, Sounding};
use proptest::prelude::*;

/// A grid from a drawing, around a start in its middle: `#` occupied, `.` free, ` ` unknown, a
/// character a cell, the first line furthest in y. The start's cell is (100, 100).
struct Drawn {
    grid: OccupancyGrid,
    planner: Planner,
    start: Pose,
}

const START: Pose = Pose { x_m: 0.025, y_m: 0.025, heading_rad: 0.0 };

impl Drawn {
    fn of(lines: &[&str], robot: [i32; 2]) -> Self {
        let mut grid = OccupancyGrid::around(&START);
        let top = i32::try_from(lines.len()).unwrap() / 2;
        for (y, line) in (0..).zip(lines) {
            let left = i32::try_from(line.len()).unwrap() / 2;
            for (x, letter) in (0..).zip(line.chars()) {
                let cell = [x - left, top - y];
                match letter {
                    '#' => put(&mut grid, cell, 100),
                    '.' => put(&mut grid, cell, -100),
                    _ => {}
                }
            }
        }
        let planner = Planner::new(&grid, &START).expect("a usual grid");
        let [x_m, y_m] = robot.map(|cell| (f64::from(cell) + 0.5) * 0.05);
        let start = Pose { x_m, y_m, heading_rad: 0.0 };
        Self { grid, planner, start }
    }

    fn stand(&mut self, pose: Pose) {
        self.planner.note(&Estimate { pose, ..Estimate::default() }, 2.0);
    }

    fn hear(&mut self, sounding: Sounding) {
        let sounding = Some(sounding);
        self.planner.note(&Estimate { pose: self.start, sounding, ..Estimate::default() }, 2.0);
    }

    fn plan(&mut self, request: &Request) -> (Plan, usize) {
        self.stand(self.start);
        for ticks in 1..2000 {
            if let Some(plan) = self.planner.step(Some(request), &self.grid, &self.start) {
                return (plan.clone(), ticks);
            }
        }
        panic!("no plan");
    }
}

/// Makes a cell of the lattice free or occupied, through the sensor's own model.
fn put(grid: &mut OccupancyGrid, [x, y]: [i32; 2], log_odds: i8) {
    grid.set_for_tests(x, y, log_odds);
}

fn exploring(serial: u32) -> Request {
    Request {
        serial,
        goal: Goal::Frontier { within_m: 5.0 },
        keep_m: 0.15,
        looked: None,
        turn_m: 0.15,
        again: false,
        obstacle: None,
    }
}

fn to_place(serial: u32, [x, y]: [i32; 2]) -> Request {
    let [x_m, y_m] = [x, y].map(|cell| (f64::from(cell) + 0.5) * 0.05);
    Request { goal: Goal::Place { x_m, y_m }, ..exploring(serial) }
}

/// A room of 40 by 20 cells whose right wall is open in the middle.
fn room() -> Vec<String> {
    let wall = "#".repeat(42);
    let mut lines = vec![wall.clone()];
    for row in 0..20 {
        let end = if (6..14).contains(&row) { ' ' } else { '#' };
        lines.push(format!("#{}{end}", ".".repeat(40)));
    }
    lines.push(wall);
    lines
}

fn drawn(lines: &[String], robot: [i32; 2]) -> Drawn {
    let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
    Drawn::of(&lines, robot)
}

/// An echo from every occupied cell, so often.
fn hear(drawn: &mut Drawn, times: usize) {
    for row in 0..200 {
        for column in 0..200 {
            if drawn.grid.cell(column, row) != crate::mapping::Cell::Occupied {
                continue;
            }
            let [x_m, y_m] = drawn.grid.origin_m();
            let place = |cell: usize, m: f64| (cell as f64 + 0.5) * 0.05 + m;
            let one = sounding(place(column, x_m) - 0.1, place(row, y_m), 0.0, 0.1);
            for _ in 0..times {
                drawn.hear(one);
            }
        }
    }
}

fn sounding(x_m: f64, y_m: f64, direction: f64, range_m: f64) -> Sounding {
    let beam = [libm::cos(direction), libm::sin(direction)];
    let range = Range::Echo(range_m);
    Sounding {
        time_ns: 0,
        x_m,
        y_m,
        beam,
        echo: beam,
        half_cone_rad: 0.21,
        range,
        fresh: true,
        waits: false,
    }
}

#[test]
fn the_gap_in_the_wall_is_where_to_go() {
    let mut drawn = drawn(&room(), [-15, 0]);
    hear(&mut drawn, 2);
    let (plan, ticks) = drawn.plan(&exploring(1));
    assert_eq!(plan.outcome, Outcome::Way);
    let [x_m, y_m] = plan.goal();
    assert!((x_m - 0.95).abs() < 0.1 && y_m.abs() < 0.25, "({x_m}, {y_m})");
    let end = plan.waypoints().next_back().expect("a way");
    assert!(end[0] < 0.8 && end[0] > 0.5, "it looks from some way off: {end:?}");
    assert!(ticks < 60, "{ticks} ticks");
}

#[test]
fn what_is_further_from_home_comes_first_where_the_way_there_is_not_much_longer() {
    // Home is in the middle; what is unknown on the left is nearer to the robot than that on the
    // right.
    let mut room = room();
    for line in &mut room[8..14] {
        line.replace_range(..13, &" ".repeat(13));
    }
    let mut drawn = drawn(&room, [3, 0]);
    hear(&mut drawn, 2);
    // Beams went through all of the floor.
    drawn.planner.survey.swept.fill_square(Place { column: 100, row: 100 }, 21);
    let [x_m, y_m] = drawn.plan(&exploring(1)).0.goal();
    assert!(x_m > 0.9 && y_m.abs() < 0.25, "({x_m}, {y_m})");
}

#[test]
fn what_is_by_a_wall_comes_before_the_open_outside() {
    // Floor leads out of the gap, and the robot is at its end.
    let indent = " ".repeat(40);
    let lines: Vec<String> = (0..)
        .zip(&room())
        .map(|(row, line)| {
            let outside = if (7..15).contains(&row) { "." } else { " " };
            format!("{indent}{}{}", line.trim_end(), outside.repeat(41))
        })
        .collect();
    let mut drawn = drawn(&lines, [55, 0]);
    hear(&mut drawn, 2);
    drawn.planner.survey.swept.fill_square(Place { column: 100, row: 100 }, 61);
    let [x_m, y_m] = drawn.plan(&exploring(1)).0.goal();
    assert!((1.1..2.2).contains(&x_m) && y_m.abs() < 0.25, "({x_m}, {y_m})");
}

#[test]
fn what_was_looked_at_is_asked_for_no_more_and_then_nothing_is_left() {
    let mut drawn = drawn(&room(), [15, 0]);
    hear(&mut drawn, 2);
    let mut looks = 0;
    let mut request = exploring(1);
    while drawn.plan(&request).0.outcome != Outcome::Nothing {
        looks += 1;
        assert!(looks < 10, "it ends");
        request = Request { looked: Some(View::Ahead), ..exploring(request.serial + 1) };
    }
    assert!(looks > 0);
}

#[test]
fn a_wall_without_a_point_is_of_interest_as_well() {
    let mut room = room();
    for line in &mut room {
        *line = line.replace(' ', "#");
    }
    let mut drawn = drawn(&room, [0, 0]);
    assert_eq!(drawn.plan(&exploring(1)).0.outcome, Outcome::Way);
    hear(&mut drawn, 2);
    assert_eq!(drawn.plan(&exploring(2)).0.outcome, Outcome::Nothing);
}

#[test]
fn a_way_leads_round_a_wall_and_keeps_away_from_it() {
    let mut room = room();
    for line in room.iter_mut().take(14) {
        line.replace_range(20..22, "##");
    }
    let mut drawn = drawn(&room, [-10, 5]);
    hear(&mut drawn, 2);
    let (plan, _) = drawn.plan(&to_place(1, [10, 5]));
    assert_eq!(plan.outcome, Outcome::Way);
    let way: Vec<[f64; 2]> = plan.waypoints().collect();
    assert!(way.iter().any(|[_, y_m]| *y_m < -0.1), "{way:?}");
    for [x_m, y_m] in way {
        // The wall in the middle: x from -0.05 to 0.05, y from -0.1 on.
        let beside_m = (x_m.abs() - 0.05).max(0.0);
        let below_m = (-0.1 - y_m).max(0.0);
        assert!(libm::hypot(beside_m, below_m) > 0.12, "({x_m}, {y_m})");
    }
}

#[test]
fn a_known_way_is_taken_however_much_shorter_one_over_what_is_not_known_would_be() {
    let arms = format!("{0}{1:6}{0}", ".".repeat(9), "");
    let mut lines = vec![arms.as_str(); 30];
    let bend = ".".repeat(24);
    lines.extend([bend.as_str(); 9]);
    let mut drawn = Drawn::of(&lines, [-8, 14]);
    let (plan, _) = drawn.plan(&to_place(1, [7, 14]));
    assert_eq!(plan.outcome, Outcome::Way);
    let least_m = plan.waypoints().map(|[_, y_m]| y_m).fold(f64::INFINITY, f64::min);
    assert!(least_m < -0.55, "round the bend: {least_m}");
}

#[test]
fn a_place_behind_walls_is_come_near_to() {
    let mut room = room();
    for line in &mut room {
        line.replace_range(20..22, "##");
    }
    let mut drawn = drawn(&room, [-10, 0]);
    hear(&mut drawn, 2);
    let (plan, _) = drawn.plan(&to_place(1, [10, 0]));
    assert_eq!(plan.outcome, Outcome::Near);
    let end = plan.waypoints().next_back().expect("a way");
    assert!(end[0] < -0.15 && end[0] > -0.4, "{end:?}");
}

/// A room with a wall in its middle that has a passage of seven cells.
#[test]
fn a_place_out_of_sight_is_looked_for_through_what_is_not_known_until_that_was_looked_at() {
    let mut drawn = drawn(&room(), [-15, 0]);
    hear(&mut drawn, 2);
    let outside = [30, 0];
    let (plan, _) = drawn.plan(&to_place(1, outside));
    assert_eq!(plan.outcome, Outcome::Frontier);
    let ([x_m, y_m], end) = (plan.goal(), plan.waypoints().next_back().expect("a way"));
    assert!((0.8..1.1).contains(&x_m) && y_m.abs() < 0.25, "the gap is looked at: ({x_m}, {y_m})");
    assert!(end[0] < x_m, "and the way ends before it: {end:?}");
    let (mut serial, mut looks) = (2, 0);
    let looked = Some(View::Ahead);
    while drawn.plan(&Request { looked, ..to_place(serial, outside) }).0.outcome
        == Outcome::Frontier
    {
        (serial, looks) = (serial + 1, looks + 1);
        assert!(looks < 12, "it ends");
    }
    assert!(looks > 0, "{looks} looks");
    let (plan, _) = drawn.plan(&to_place(serial + 1, outside));
    assert_eq!(plan.outcome, Outcome::Near, "looked at in vain, the gap is as good as closed");
    let again = Request { again: true, ..to_place(serial + 2, outside) };
    assert_eq!(drawn.plan(&again).0.outcome, Outcome::Frontier);
}

fn rooms() -> Vec<String> {
    let mut rooms = room();
    for (at, line) in rooms.iter_mut().enumerate() {
        if !(7..14).contains(&at) {
            line.replace_range(20..22, "##");
        }
    }
    rooms
}

#[test]
fn a_passage_that_echoes_have_closed_is_doubted_and_one_heard_from_near_only_once_more() {
    for (range_m, then) in [(0.6, Outcome::Way), (0.3, Outcome::Near)] {
        let mut drawn = drawn(&rooms(), [-10, 0]);
        hear(&mut drawn, 2);
        for row in -4..=4 {
            let y_m = (f64::from(row) + 0.5) * 0.05;
            for _ in 0..9 {
                let echo = sounding(-range_m, y_m, 0.0, range_m);
                drawn.hear(echo);
            }
        }
        assert_eq!(drawn.plan(&to_place(1, [10, 0])).0.outcome, Outcome::Near, "{range_m}");
        let again = Request { again: true, ..to_place(2, [10, 0]) };
        assert_eq!(drawn.plan(&again).0.outcome, then, "{range_m}");
        let passage = drawn.planner.survey.place(-0.02, 0.02).unwrap();
        assert!(drawn.planner.survey.pointed.has(passage), "points stand in it");
        let once_more = Request { serial: 3, ..again };
        assert_eq!(drawn.plan(&once_more).0.outcome, Outcome::Way, "{range_m}");
        assert!(!drawn.planner.survey.pointed.has(passage), "and make nothing known any more");
    }
}

#[test]
fn a_passage_that_echoes_have_narrowed_or_closed_is_open_for_a_robot_that_has_driven_through() {
    let [narrowed, closed] = [vec![-4, -3, -2, 2, 3, 4], (-4..=4).collect()];
    for (rows, driven, then) in [
        (&narrowed, false, Outcome::Near),
        (&narrowed, true, Outcome::Way),
        (&closed, false, Outcome::Near),
        (&closed, true, Outcome::Way),
    ] {
        let mut drawn = drawn(&rooms(), [-10, 0]);
        hear(&mut drawn, 2);
        for column in (-10..10).filter(|_| driven) {
            let x_m = (f64::from(column) + 0.5) * 0.05;
            drawn.stand(Pose { x_m, ..START });
        }
        for row in rows {
            let y_m = (f64::from(*row) + 0.5) * 0.05;
            for _ in 0..9 {
                let echo = sounding(-0.3, y_m, 0.0, 0.3);
                drawn.hear(echo);
            }
        }
        assert_eq!(drawn.plan(&to_place(1, [10, 0])).0.outcome, then, "driven: {driven}");
        let stopped = Request { obstacle: Some([0.0, 0.025]), ..to_place(2, [10, 0]) };
        assert_eq!(drawn.plan(&stopped).0.outcome, Outcome::Near, "what has stopped it counts");
        let again = Request { again: true, ..to_place(3, [10, 0]) };
        assert_eq!(drawn.plan(&again).0.outcome, then, "where it once stood nothing stands");
    }
}

#[test]
fn the_way_home_is_that_over_the_map_and_grows_as_the_robot_drives_on() {
    let mut walled = room();
    for line in walled.iter_mut().skip(11) {
        line.replace_range(25..27, "##");
    }
    let mut drawn = drawn(&walled, [12, 0]);
    hear(&mut drawn, 2);
    assert_eq!(drawn.planner.home_m(&drawn.start), None, "nothing is planned yet");
    // It came that way.
    for [x_m, y_m] in [[0.0, 0.0], [0.0, 0.2], [0.1, 0.3], [0.2, 0.35], [0.3, 0.35], [0.4, 0.3]] {
        drawn.stand(Pose { x_m, y_m, heading_rad: 0.0 });
    }
    for request in [exploring(1), to_place(2, [15, 0])] {
        drawn.plan(&request);
        while drawn.planner.phase != Phase::Idle {
            assert_eq!(drawn.planner.step(None, &drawn.grid, &drawn.start), None);
        }
        let home_m = drawn.planner.home_m(&drawn.start).expect("there is a way");
        assert!((1.2..2.0).contains(&home_m), "round the wall, for 0.6 m through it: {home_m} m");
        let further = Pose { x_m: drawn.start.x_m + 0.2, ..drawn.start };
        let more_m = drawn.planner.home_m(&further).expect("there is a way") - home_m;
        assert!((more_m - 0.2).abs() < 0.03, "{more_m} m");
    }
}

#[test]
fn a_narrow_piece_of_the_way_home_counts_for_more_until_it_was_driven() {
    let mut walled = room();
    for (row, line) in walled.iter_mut().enumerate() {
        if !(7..15).contains(&row) {
            line.replace_range(25..27, "##");
        }
    }
    let mut drawn = drawn(&walled, [12, 0]);
    hear(&mut drawn, 2);
    let home_m = |drawn: &mut Drawn, serial| {
        drawn.plan(&exploring(serial));
        while drawn.planner.phase != Phase::Idle {
            drawn.planner.step(None, &drawn.grid, &drawn.start);
        }
        drawn.planner.home_m(&drawn.start).expect("there is a way")
    };
    let before_m = home_m(&mut drawn, 1);
    for cell in 0..=12 {
        drawn.stand(Pose { x_m: f64::from(cell) * 0.05, ..START });
    }
    let after_m = home_m(&mut drawn, 2);
    assert!(before_m > 3.0 && (0.6..1.6).contains(&after_m), "{before_m} m, {after_m} m");
}

#[test]
fn a_robot_without_room_to_turn_goes_back_the_way_that_it_came() {
    let mut drawn = drawn(&room(), [-19, 0]);
    hear(&mut drawn, 2);
    let tight = Request { keep_m: 0.05, ..to_place(1, [0, 0]) };
    assert!(!drawn.plan(&tight).0.retraces(), "it has never been there");
    for column in 0..20 {
        let x_m = drawn.start.x_m + f64::from(column) * 0.05;
        drawn.stand(Pose { x_m, ..drawn.start });
    }
    let plan = drawn.plan(&Request { serial: 2, ..tight }).0;
    assert!(plan.retraces() && !plan.is_cramped());
    // Where nothing is heard near, it has room, until it turns out that it has not.
    drawn.start.x_m = 0.0;
    let plan = drawn.plan(&to_place(3, [-10, 0])).0;
    assert!(!plan.retraces() && !plan.is_cramped());
    drawn.planner.cramp();
    let plan = drawn.plan(&to_place(4, [-10, 0])).0;
    assert!(plan.retraces() && plan.is_cramped());
    drawn.start.x_m = 0.3;
    assert!(!drawn.plan(&to_place(5, [-10, 0])).0.is_cramped());
}

#[test]
fn an_echo_that_was_heard_once_closes_no_passage_and_an_obstacle_does_for_a_while() {
    let far = [10, 0];
    let mut free = drawn(&rooms(), [-10, 0]);
    hear(&mut free, 2);
    free.hear(sounding(-0.1, 0.0, 0.0, 0.1));
    let (way, _) = free.plan(&to_place(1, far));
    assert_eq!(way.outcome, Outcome::Way);
    let obstacle = Some([0.0, 0.0]);
    let blocked = free.plan(&Request { obstacle, ..to_place(2, far) }).0;
    assert_eq!(blocked.outcome, Outcome::Near);
    let again = (3..40).find(|serial| free.plan(&to_place(*serial, far)).0.outcome == Outcome::Way);
    assert!(again.is_some(), "what the map does not confirm is forgotten");
}

#[test]
fn what_was_guessed_to_close_a_passage_opens_it_where_the_sweep_places_it_elsewhere() {
    // Where the echoes lie in the end: the passage's side, the passage, and nowhere but the last.
    for (placed, y_m, then) in
        [(9, 0.6, Outcome::Way), (9, 0.0, Outcome::Near), (1, 0.6, Outcome::Way)]
    {
        let mut drawn = drawn(&rooms(), [-10, 0]);
        hear(&mut drawn, 2);
        for time_ns in 1..=9 {
            drawn.hear(Sounding { time_ns, waits: true, ..sounding(-0.3, 0.0, 0.0, 0.3) });
        }
        let guessed = drawn.plan(&to_place(1, [10, 0])).0;
        assert_eq!(guessed.outcome, Outcome::Near, "until the sweep is over something is there");
        for time_ns in 10 - placed..=9 {
            let placed = [MapPoint { time_ns, x_m: 0.0, y_m }].into_iter().collect();
            let estimate = Estimate { pose: drawn.start, placed, ..Estimate::default() };
            drawn.planner.note(&estimate, 2.0);
        }
        let way = drawn.plan(&to_place(2, [10, 0])).0;
        assert_eq!(way.outcome, then, "{placed} at {y_m} m");
    }
}

#[test]
fn a_robot_that_stands_too_near_to_a_wall_gets_away() {
    let mut drawn = drawn(&room(), [-19, 0]);
    hear(&mut drawn, 2);
    let (plan, _) = drawn.plan(&to_place(1, [10, 0]));
    assert_eq!(plan.outcome, Outcome::Way);
}

#[test]
fn a_grid_too_large_has_no_planner() {
    let grid = OccupancyGrid::covering([0.0, 0.0], [20.0, 5.0]).expect("a grid");
    assert!(Planner::new(&grid, &START).is_none());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn ways_over_any_map_lead_from_cell_to_cell_and_through_nothing_solid(
        soundings in prop::collection::vec((-1.0..1.0, -1.0..1.0, -3.2..3.2, 0.1..1.9), 5..60),
        x in -20..20, y in -20..20, explores in any::<bool>(), looked in any::<bool>(),
    ) {
        let mut grid = OccupancyGrid::around(&START);
        let mut heard = Vec::new();
        for (x_m, y_m, direction, range) in soundings {
            heard.push(sounding(x_m, y_m, direction, range));
        }
        for one in heard.iter().flat_map(|one| std::iter::repeat_n(one, 5)) {
            grid.add(one, 2.0);
        }
        let planner = Planner::new(&grid, &START).expect("a usual grid");
        let mut drawn = Drawn { grid, planner, start: START };
        for one in heard {
            drawn.hear(one);
        }
        let request = if explores { exploring(1) } else { to_place(1, [x, y]) };
        let request = Request { looked: looked.then_some(View::Around), ..request };
        let (plan, ticks) = drawn.plan(&request);
        prop_assert!(ticks < 500, "{} ticks", ticks);
        let (again, _) = drawn.plan(&Request { serial: 2, ..request });
        if !looked {
            prop_assert_eq!(plan.waypoints().len(), again.waypoints().len());
        }
        let way: Vec<[f64; 2]> = plan.waypoints().collect();
        for two in way.windows(2) {
            let far_m = libm::hypot(two[0][0] - two[1][0], two[0][1] - two[1][1]);
            prop_assert!(far_m < 0.16, "{:?}", two);
        }
        for [x_m, y_m] in way {
            let near_start = libm::hypot(x_m - START.x_m, y_m - START.y_m) < 0.22;
            prop_assert!(near_start || drawn.grid.at(x_m, y_m) == crate::mapping::Cell::Free);
        }
    }
}
