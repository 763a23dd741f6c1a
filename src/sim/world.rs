//! Simulated rooms: what stands in them, what is drawn on the floor, where the robots start.
//!
//! A world is a TOML file ([`World::parse`], commented template: [`World::TEMPLATE`]) or one of the
//! built-in ones ([`World::named`]). Frame: metres, x and y as the file has them, headings
//! anticlockwise from x.
//!
//! | name | for |
//! |---|---|
//! | `arena` | the default: cinder blocks round 2.5 by 2 m as in the seed, and a few inside |
//! | `rooms`, `cylinders`, `corridor` | maps; nothing was tuned on these three |
//! | `line` | a closed dark line on a white floor |
//! | `table` | a floor that ends, no walls |
//! | `patches` | coloured patches on the floor |
//! | `wall` | something to follow |
//! | `open` | nothing around |
//! | `two-arenas` | two robots, the second at (3, 0) turned by +90° |
//!
//! # Not here
//!
//! Nothing that moves: `sim::world_physics`.
//!
//! # What we count on
//!
//! A world does not change while robots drive in it, and has at most [`World::MAX_THINGS`] things
//! in each list.

use std::fmt;

use super::body::Outline;
use super::fault::Scenario;
use crate::document::{Document, Findings};
use crate::units::{degrees, rounded_to};

mod coverage;
mod floor;
pub(in crate::sim) mod geometry;
mod parse;
pub(in crate::sim) mod robot;

pub use coverage::covered;
pub(in crate::sim) use floor::{Floor, Ground, Mark};
pub use robot::{Errors, OwnEcho, RobotModel};

use geometry::{Disc, Point, Surfaces};

/// A simulated room.
#[derive(Debug, Clone)]
pub struct World {
    name: String,
    pub(in crate::sim) surfaces: Surfaces,
    /// The corners of what has an inside.
    solids: Vec<[Point; 4]>,
    outlines: Vec<Vec<[f64; 2]>>,
    pub(in crate::sim) floor: Floor,
    starts: Vec<StartPose>,
    pub(in crate::sim) remote: Vec<RemotePress>,
    pub(in crate::sim) beacon: Option<Beacon>,
    scenario: Scenario,
    robot: RobotModel,
}

/// Where a robot starts, in the world's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StartPose {
    /// Metres.
    pub x_m: f64,
    /// Metres.
    pub y_m: f64,
    /// Radians, anticlockwise from x.
    pub heading_rad: f64,
}

impl fmt::Display for StartPose {
    /// As `--pose` takes it: metres, metres, degrees.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let heading_deg = rounded_to(degrees(self.heading_rad), 100.0);
        write!(f, "{},{},{heading_deg}", self.x_m, self.y_m)
    }
}

/// A button held on the infrared remote.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::sim) struct RemotePress {
    pub(in crate::sim) from_s: f64,
    pub(in crate::sim) to_s: f64,
    /// 0 to 3 for channels 1 to 4.
    pub(in crate::sim) channel: usize,
    /// 1 to 11.
    pub(in crate::sim) code: i32,
}

/// The remote laid down as a beacon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::sim) struct Beacon {
    pub(in crate::sim) place: Point,
    pub(in crate::sim) channel: usize,
}

macro_rules! built_in {
    ($($name:literal),+) => {
        const BUILT_IN: &[(&str, &str)] =
            &[$(($name, include_str!(concat!("worlds/", $name, ".toml")))),+];
    };
}
built_in!(
    "arena",
    "rooms",
    "cylinders",
    "corridor",
    "line",
    "table",
    "patches",
    "wall",
    "open",
    "two-arenas"
);

impl World {
    /// The most walls, blocks, circles, marks, starts or presses that a file may have of each.
    pub const MAX_THINGS: usize = 2000;
    /// A commented file for authors of worlds: every key with its unit and its default.
    pub const TEMPLATE: &'static str = include_str!("worlds/template.toml");

    /// The names of the built-in worlds; the first is the default.
    pub fn names() -> impl Iterator<Item = &'static str> {
        BUILT_IN.iter().map(|(name, _)| *name)
    }

    /// The file of a built-in world; `None` for an unknown name.
    #[must_use]
    pub fn text(name: &str) -> Option<&'static str> {
        BUILT_IN.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
    }

    /// A built-in world; `None` for an unknown name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        // The files are part of this program, and a test reads each of them.
        Self::parse(name, Self::text(name)?.as_bytes()).ok().map(|(world, _)| world)
    }

    /// Reads a world from the bytes of a file; `file` is what findings call it. Warnings come back
    /// beside the world.
    ///
    /// # Errors
    ///
    /// All mistakes with their places: what is not TOML, unknown keys, numbers out of range, too
    /// many things, shapes with too few points, a robot that starts in a wall or in another robot.
    pub fn parse(file: &str, bytes: &[u8]) -> Result<(Self, Findings), Findings> {
        Document::new(file, bytes)?.read(parse::world)
    }

    /// The world's name, as its file has it.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Everything that stands in the world as polylines in metres, for drawing; closed ones repeat
    /// their first point.
    #[must_use]
    pub fn outlines(&self) -> &[Vec<[f64; 2]>] {
        &self.outlines
    }

    /// The corners of the blocks, metres; their outlines are among the others.
    pub fn blocks(&self) -> impl Iterator<Item = Vec<[f64; 2]>> {
        self.solids
            .iter()
            .map(|corners| corners.iter().map(|corner| [corner.x, corner.y]).collect())
    }

    /// The corners of the floor, metres; empty for one without an edge.
    #[must_use]
    pub fn edge(&self) -> Vec<[f64; 2]> {
        self.floor.table.iter().map(|corner| [corner.x, corner.y]).collect()
    }

    /// Distance from a place to the nearest surface, in metres: how far off a map's point is.
    /// Infinite in a world without surfaces.
    #[must_use]
    pub fn distance_to_nearest_surface(&self, x_m: f64, y_m: f64) -> f64 {
        self.surfaces.distance(Point::new(x_m, y_m))
    }

    /// True where the robot would stand clear of all that stands in the world.
    pub(in crate::sim) fn is_clear(&self, pose: StartPose) -> bool {
        let place = Point::new(pose.x_m, pose.y_m);
        let outline = Outline::new(&self.robot).at(place, pose.heading_rad);
        let in_solid = |corners: &[Point; 4]| {
            geometry::contains(corners, place)
                || corners.iter().any(|corner| outline.covers(*corner))
        };
        let in_disc = |disc: &Disc| {
            (disc.centre - place).norm() <= disc.radius_m || outline.covers(disc.centre)
        };
        !self.solids.iter().any(in_solid)
            && !self.surfaces.discs.iter().any(in_disc)
            && outline.clearance(&self.surfaces) > 0.0
    }

    /// What goes wrong, and which buttons are pressed, since the simulation began.
    #[must_use]
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// The start poses, one for each robot that the world has place for.
    #[must_use]
    pub fn starts(&self) -> &[StartPose] {
        &self.starts
    }

    /// The same world with the start pose first that is nearest to a place, metres.
    #[must_use]
    pub fn with_start_near(mut self, x_m: f64, y_m: f64) -> Self {
        let far = |start: &StartPose| libm::hypot(start.x_m - x_m, start.y_m - y_m);
        self.starts.sort_by(|one, other| far(one).total_cmp(&far(other)));
        self
    }

    /// The true robot; all robots of a world are built alike.
    #[must_use]
    pub fn robot(&self) -> &RobotModel {
        &self.robot
    }

    /// The same world with a robot that has no imperfections.
    #[must_use]
    pub fn without_errors(mut self) -> Self {
        self.robot.errors = Errors::NONE;
        self
    }

    fn add_polyline(&mut self, points: &[Point], closed: bool) {
        self.surfaces.add_polyline(points, closed);
        let again = points.first().filter(|_| closed);
        self.outlines.push(points.iter().chain(again).map(|p| [p.x, p.y]).collect());
    }

    fn add_disc(&mut self, disc: Disc) {
        let corner = |n: i32| {
            let point = disc.centre
                + geometry::direction(crate::units::radians(f64::from(n) * 10.0)) * disc.radius_m;
            [point.x, point.y]
        };
        self.outlines.push((0..=36).map(corner).collect());
        self.surfaces.discs.push(disc);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_robot_stands_on_the_start_pose_that_is_nearest_to_where_it_is_told_to_be() {
        let first = |x_m, y_m| {
            let world = World::named("two-arenas").unwrap().with_start_near(x_m, y_m);
            (world.starts()[0].x_m, world.starts().len())
        };
        assert_eq!((first(0.0, 0.0), first(2.9, 0.1)), ((0.0, 2), (3.0, 2)));
        assert_eq!(first(f64::NAN, 0.0).1, 2);
    }

    #[test]
    fn every_built_in_world_reads_without_a_finding() {
        for (name, text) in BUILT_IN {
            let (world, findings) =
                World::parse(name, text.as_bytes()).unwrap_or_else(|findings| panic!("{findings}"));
            assert!(findings.is_empty(), "{findings}");
            assert_eq!(world.name(), *name);
            assert!(!world.starts().is_empty(), "{name}");
        }
        assert!(
            World::parse("template", World::TEMPLATE.as_bytes())
                .is_ok_and(|(_, notes)| notes.is_empty())
        );
    }

    #[test]
    fn the_template_with_its_comments_taken_away_is_a_world_too() {
        let uncommented: String = World::TEMPLATE
            .lines()
            .map(|line| line.strip_prefix("#: ").unwrap_or(line))
            .flat_map(|line| [line, "\n"])
            .collect();
        let (world, _) = World::parse("template", uncommented.as_bytes())
            .unwrap_or_else(|findings| panic!("{findings}"));
        assert_eq!(world.robot(), &RobotModel::default(), "the template shows the defaults");
        assert_eq!(world.remote.len(), 1);
    }

    #[test]
    fn the_distance_to_a_block_is_to_its_side() {
        let text = "name = \"t\"\n[[block]]\nat = [1.0, 0.0]\nsize_m = [0.4, 0.2]\n";
        let (world, _) = World::parse("t", text.as_bytes()).unwrap();
        assert!((world.distance_to_nearest_surface(0.0, 0.0) - 0.8).abs() < 1e-12);
        assert!((world.distance_to_nearest_surface(1.0, 0.05) - 0.05).abs() < 1e-12);
        assert_eq!(world.outlines().len(), 1);
        assert_eq!(world.outlines()[0].len(), 5);
    }
}
