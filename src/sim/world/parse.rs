//! From `world.toml` to a [`World`].
//!
//! # Not here
//!
//! The robot's own section: `robot`.

use super::geometry::{Disc, Point, contains, rectangle};
use super::robot::number;
use super::{Beacon, Floor, Ground, Mark, RemotePress, RobotModel, StartPose, Surfaces, World};
use crate::document::{Item, Kind, Section, Severity};
use crate::ev3dev::Colour;
use crate::sim::fault::Scenario;
use crate::units::radians;

/// Furthest from the origin that anything stands, metres.
const FAR_M: f64 = 100.0;
const CLOSED: &str = "closed";

/// Takes a world's document apart.
pub(super) fn world(root: &Section<'_>) -> Option<World> {
    if root.is_of_another_kind(Kind::World) {
        return None;
    }
    let own = [
        "name", "floor", "wall", "block", "circle", "line", "patch", "start", "remote", "beacon",
        "robot",
    ];
    root.allow(&[own.as_slice(), &Scenario::KEYS].concat());
    let name = root.require("name")?.text()?.to_owned();
    let mut world = World {
        name,
        surfaces: Surfaces::default(),
        solids: Vec::new(),
        outlines: Vec::new(),
        floor: floor(root),
        starts: Vec::new(),
        remote: things(root, "remote").iter().filter_map(press).collect(),
        beacon: root.section("beacon").and_then(|section| beacon(&section)),
        scenario: Scenario::read(root).unwrap_or_default(),
        robot: root
            .section("robot")
            .map_or_else(RobotModel::default, |section| RobotModel::read(&section)),
    };
    let mut rooms = Vec::new();
    for wall in things(root, "wall") {
        wall.allow(&["points", CLOSED]);
        if let Some(points) = points(&wall, 2) {
            let closed = flag(&wall, CLOSED);
            world.add_polyline(&points, closed);
            rooms.extend(Some(points).filter(|_| closed));
        }
    }
    for block in things(root, "block") {
        if let Some(corners) = self::block(&block) {
            world.add_polyline(&corners, true);
            world.solids.push(corners);
        }
    }
    for circle in things(root, "circle") {
        circle.allow(&["at", "radius_m"]);
        let radius = circle.require("radius_m").and_then(|item| item.number(0.001..=FAR_M));
        if let (Some(centre), Some(radius_m)) = (place(&circle), radius) {
            world.add_disc(Disc { centre, radius_m });
        }
    }
    world.surfaces.find_corners();
    starts(root, &mut world, &rooms);
    Some(world)
}

/// The tables of a list such as `[[wall]]`.
fn things<'d>(root: &Section<'d>, key: &str) -> Vec<Section<'d>> {
    let hint = "draw a long wall as one `[[wall]]` with many points";
    root.tables(key, World::MAX_THINGS, hint)
}

fn flag(section: &Section<'_>, key: &str) -> bool {
    section.get(key).and_then(|item| item.flag()).unwrap_or(false)
}

fn point(item: &Item<'_>) -> Option<Point> {
    item.numbers::<2>(-FAR_M..=FAR_M).map(|[x, y]| Point::new(x, y))
}

fn place(section: &Section<'_>) -> Option<Point> {
    section.require("at").and_then(|item| point(&item))
}

/// The points of a shape, at least `least` of them.
fn points(section: &Section<'_>, least: usize) -> Option<Vec<Point>> {
    let item = section.require("points")?;
    shape(&item, least)
}

fn shape(item: &Item<'_>, least: usize) -> Option<Vec<Point>> {
    let list = item.list()?;
    if list.len() < least || list.len() > World::MAX_THINGS {
        item.error(format!(
            "`{}` has {}; it takes {least} to {}",
            item.path(),
            crate::units::counted(list.len(), "point"),
            World::MAX_THINGS
        ));
        return None;
    }
    let points: Vec<Point> = list.iter().filter_map(point).collect();
    (points.len() == list.len()).then_some(points)
}

fn block(section: &Section<'_>) -> Option<[Point; 4]> {
    section.allow(&["at", "size_m", "turn_deg"]);
    let size = section.require("size_m").and_then(|item| item.numbers::<2>(0.001..=FAR_M));
    let turn_deg = number(section, "turn_deg", -360.0, 360.0, 0.0);
    let (centre, [length, width]) = place(section).zip(size)?;
    Some(rectangle(centre, Point::new(length, width), radians(turn_deg)))
}

fn ground(section: &Section<'_>, default: Colour) -> Ground {
    let colour =
        section.get("colour").and_then(|item| item.word(&Ground::words())).unwrap_or(default);
    Ground::new(colour, section.get("reflect_pct").and_then(|item| item.number(0.0..=100.0)))
}

fn floor(root: &Section<'_>) -> Floor {
    let section = root.section("floor");
    if let Some(section) = &section {
        section.allow(&["colour", "reflect_pct", "table"]);
    }
    let table =
        section.as_ref().and_then(|section| section.get("table")).and_then(|item| shape(&item, 3));
    let line = |section: Section<'_>| {
        section.allow(&["points", CLOSED, "width_m", "colour", "reflect_pct"]);
        let width_m = Some(number(&section, "width_m", 0.001, 10.0, 0.02));
        let (closed, ground) = (flag(&section, CLOSED), ground(&section, Colour::Black));
        points(&section, 2).map(|points| Mark { points, width_m, closed, ground })
    };
    let patch = |section: Section<'_>| {
        section.allow(&["points", "colour", "reflect_pct"]);
        let ground = ground(&section, Colour::Black);
        points(&section, 3).map(|points| Mark { points, width_m: None, closed: true, ground })
    };
    let lines = things(root, "line").into_iter().filter_map(line);
    Floor {
        ground: section.map_or_else(
            || Ground::new(Colour::None, None),
            |section| ground(&section, Colour::None),
        ),
        marks: lines.chain(things(root, "patch").into_iter().filter_map(patch)).collect(),
        table: table.unwrap_or_default(),
    }
}

fn channel(section: &Section<'_>) -> usize {
    const CHANNELS: std::ops::RangeInclusive<i64> = 1..=4;
    let channel = section.get("channel").and_then(|item| item.integer(CHANNELS)).unwrap_or(1);
    usize::try_from(channel - 1).unwrap_or(0)
}

fn press(section: &Section<'_>) -> Option<RemotePress> {
    section.allow(&["at_s", "for_s", "channel", "code"]);
    let from = section.require("at_s").and_then(|item| item.number(0.0..=1e6));
    let for_s = number(section, "for_s", 0.0, 1e6, 0.5);
    let code = section.require("code").and_then(|item| item.integer(1..=11));
    let (from_s, code) = from.zip(code)?;
    Some(RemotePress {
        from_s,
        to_s: from_s + for_s,
        channel: channel(section),
        code: i32::try_from(code).unwrap_or(0),
    })
}

fn beacon(section: &Section<'_>) -> Option<Beacon> {
    section.allow(&["at", "channel"]);
    place(section).map(|place| Beacon { place, channel: channel(section) })
}

/// Start poses; without any, one at the origin. None may stand in something.
///
/// - `rooms`: the corners of each closed wall.
fn starts(root: &Section<'_>, world: &mut World, rooms: &[Vec<Point>]) {
    let sections = things(root, "start");
    if root.get("start").is_none() {
        let origin = StartPose { x_m: 0.0, y_m: 0.0, heading_rad: 0.0 };
        check_start(root, world, rooms, origin);
        world.starts.push(origin);
    }
    for section in sections {
        section.allow(&["at", "heading_deg"]);
        let heading_rad = radians(number(&section, "heading_deg", -360.0, 360.0, 0.0));
        let Some(place) = place(&section) else { continue };
        let start = StartPose { x_m: place.x, y_m: place.y, heading_rad };
        check_start(&section, world, rooms, start);
        world.starts.push(start);
    }
}

fn check_start(section: &Section<'_>, world: &World, rooms: &[Vec<Point>], start: StartPose) {
    let place = Point::new(start.x_m, start.y_m);
    if !rooms.is_empty() && !rooms.iter().any(|room| contains(room, place)) {
        let at = format!("({}, {})", start.x_m, start.y_m);
        let message = format!("the robot at {at} starts outside each closed wall");
        section
            .note(section.place(), Severity::Warning, message)
            .hint("put `at` inside one; what robots drive round is a `[[block]]`");
    }
    if !world.is_clear(start) {
        section
            .error(format!("the robot at ({}, {}) starts inside a wall", start.x_m, start.y_m))
            .hint(format!(
                "it reaches {} m ahead of `at`, {} m back and {} m to each side",
                world.robot.front_m, world.robot.rear_m, world.robot.half_width_m
            ));
    }
    let reach = |a: f64, b: f64, c: f64| libm::hypot(a.max(b), c);
    let size = reach(world.robot.front_m, world.robot.rear_m, world.robot.half_width_m);
    if world
        .starts
        .iter()
        .any(|other| (Point::new(other.x_m, other.y_m) - place).norm() < 2.0 * size)
    {
        section
            .error("two robots start in the same place")
            .hint(format!("keep them {} m apart", 2.0 * size));
    }
    if !world.floor.has(place) {
        section.error("the robot starts beyond the floor's edge").hint("put `at` inside `table`");
    }
}
