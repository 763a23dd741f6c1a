//! How many of the walls that are extracted from a map are there, and how many of those that are
//! there are extracted.
//!
//! - Precision: the share of the segments' length that is within 5 cm of a wall and turned against
//!   it by less than 5°. Phantom: the share that is further than 15 cm from any wall or turned by
//!   more than 12°. What is neither is a wall in a wrong place: the pose had drifted.
//! - Recall: the share of the walls' length within 5 cm of a segment, of all that can echo to the
//!   robot; beside it the same of the map's points, which no segment can do better than.
//!
//! The method was tuned on seeds 1 to 3 of all these worlds but the last, and on all real scans;
//! here are other seeds, and the last world was not tuned on.

use std::collections::BTreeMap;
use std::path::Path;

use onbrick::mapping::{MapPoint, Method, Pose, Sight, Wall, crossings, standing, stats, walls};
use onbrick::sim::{World, covered};
use onbrick::units::degrees;

use super::explore::{GAP, PILLARS, SLANTED};
use super::sonar;
use crate::missions::{job, play, robot};
use crate::support::is_long;

/// Posts and slanted blocks in a room with a step.
const CLUTTER: &str = r#"
name = "clutter"
[[start]]
at = [0.0, 0.0]
heading_deg = 15
[[wall]]
points = [[-1.2, -1.0], [2.4, -1.0], [2.4, 0.6], [1.5, 0.6], [1.5, 1.5], [-1.2, 1.5]]
closed = true
[[circle]]
at = [0.6, 0.8]
radius_m = 0.07
[[circle]]
at = [-0.6, -0.5]
radius_m = 0.11
[[block]]
at = [1.2, -0.35]
size_m = [0.5, 0.2]
turn_deg = 65
[[block]]
at = [-0.5, 1.0]
size_m = [0.6, 0.25]
turn_deg = -25
"#;

/// A true wall's ends, metres.
type Ends = [f64; 4];

/// Lengths in metres, and shares of the walls' samples.
#[derive(Debug, Clone, Copy, Default)]
struct Figures {
    segments: usize,
    length_m: f64,
    good_m: f64,
    phantom_m: f64,
    samples: f64,
    covered: f64,
    pointed: f64,
}

impl Figures {
    fn add(&mut self, other: &Self) {
        self.segments += other.segments;
        self.length_m += other.length_m;
        self.good_m += other.good_m;
        self.phantom_m += other.phantom_m;
        self.samples += other.samples;
        self.covered += other.covered;
        self.pointed += other.pointed;
    }

    /// Precision, phantoms, recall, the points' recall; percent.
    fn shares(&self) -> [f64; 4] {
        let of_length = |m: f64| 100.0 * m / self.length_m.max(f64::MIN_POSITIVE);
        let of_walls = |count: f64| 100.0 * count / self.samples;
        [
            of_length(self.good_m),
            of_length(self.phantom_m),
            of_walls(self.covered),
            of_walls(self.pointed),
        ]
    }

    fn print(&self, name: &str) {
        let [precision, phantom, recall, points] = self.shares();
        println!(
            "  {name:26} {:4} {:6.1}   {precision:4.0} {phantom:4.0}   {recall:4.0} {points:4.0}",
            self.segments, self.length_m
        );
    }
}

fn to_wall([x1, y1, x2, y2]: &Ends, [x, y]: [f64; 2]) -> f64 {
    let (dx, dy) = (x2 - x1, y2 - y1);
    let along = (((x - x1) * dx + (y - y1) * dy) / (dx * dx + dy * dy)).clamp(0.0, 1.0);
    libm::hypot(x - x1 - along * dx, y - y1 - along * dy)
}

/// The angle between a wall and a segment, degrees, 0 to 90.
fn between(wall: &Ends, segment: &Wall) -> f64 {
    let direction = |[x1, y1, x2, y2]: Ends| degrees(libm::atan2(y2 - y1, x2 - x1));
    let ([x1, y1], [x2, y2]) = (segment.from_m, segment.to_m);
    let turn = (direction(*wall) - direction([x1, y1, x2, y2])).rem_euclid(180.0);
    turn.min(180.0 - turn)
}

fn judge(found: &[Wall], points: &[[f64; 2]], truth: &[Ends], samples: &[[f64; 2]]) -> Figures {
    let mut figures = Figures { segments: found.len(), ..Figures::default() };
    let mut along: Vec<[f64; 2]> = Vec::new();
    for segment in found {
        let count = (segment.length_m() / 0.01).ceil();
        let mut at = 0.5;
        while at < count {
            let place = [0, 1].map(|axis| {
                segment.from_m[axis] + at / count * (segment.to_m[axis] - segment.from_m[axis])
            });
            let within = |m: f64, deg: f64| {
                truth.iter().any(|wall| to_wall(wall, place) < m && between(wall, segment) < deg)
            };
            let part_m = segment.length_m() / count;
            figures.length_m += part_m;
            figures.good_m += if within(0.05, 5.0) { part_m } else { 0.0 };
            figures.phantom_m += if within(0.15, 12.0) { 0.0 } else { part_m };
            along.push(place);
            at += 1.0;
        }
    }
    figures.samples = samples.len() as f64;
    let share = |places: &[[f64; 2]]| covered(samples, places.iter().copied(), 0.05).unwrap();
    figures.covered = share(&along) * figures.samples;
    figures.pointed = share(points) * figures.samples;
    figures
}

/// How far segments are from the wall that they are of, in their own standard deviations: offset
/// at the middle, and direction.
fn deviations(found: &[Wall], truth: &[Ends]) -> [Vec<f64>; 2] {
    let mut all: [Vec<f64>; 2] = Default::default();
    for segment in found {
        let middle = [0, 1].map(|axis| (segment.from_m[axis] + segment.to_m[axis]) / 2.0);
        let nearest = truth
            .iter()
            .filter(|wall| between(wall, segment) < 12.0 && to_wall(wall, middle) < 0.15)
            .min_by(|a, b| to_wall(a, middle).total_cmp(&to_wall(b, middle)));
        if let Some(wall) = nearest {
            all[0].push(to_wall(wall, middle) / segment.offset_sd_m);
            all[1].push(between(wall, segment).to_radians() / segment.direction_sd_rad);
        }
    }
    all
}

/// The straight walls of a world; posts are polygons with sides shorter than 10 cm.
fn straight(world: &World) -> Vec<Ends> {
    let sides = world.outlines().iter().flat_map(|outline| outline.windows(2));
    let ends = sides.map(|side| [side[0][0], side[0][1], side[1][0], side[1][1]]);
    ends.filter(|[x1, y1, x2, y2]| libm::hypot(x2 - x1, y2 - y1) > 0.1).collect()
}

/// Rooms of all kinds.
pub(super) fn worlds() -> [(&'static str, &'static str); 8] {
    let built_in = |name| (name, World::text(name).unwrap());
    let [arena, rooms, cylinders, corridor] =
        ["arena", "rooms", "cylinders", "corridor"].map(built_in);
    let ours = [("pillars", PILLARS), ("gap", GAP), ("slanted", SLANTED), ("clutter", CLUTTER)];
    let [pillars, gap, slanted, clutter] = ours;
    [arena, rooms, cylinders, corridor, pillars, gap, slanted, clutter]
}

#[test]
#[cfg_attr(target_arch = "arm", ignore = "long runs, the same bits as on a PC")]
fn figures_of_walls_in_simulated_rooms() {
    let is_long = is_long();
    println!(
        "walls: segments, metres; precision, phantoms %; recall of segments, of points %; mission \
         explore, 300 s"
    );
    let (mut all, mut off): (BTreeMap<&str, Figures>, [Vec<f64>; 2]) = Default::default();
    for (name, text) in worlds() {
        for echo in ["lobe", "cone"] {
            let text = format!("{text}\n[robot]\necho = \"{echo}\"\n");
            let world = World::parse(name, text.as_bytes()).unwrap().0;
            let start = world.starts()[0];
            let samples = world.echoing_walls(start.x_m, start.y_m, 2.0);
            let truth = straight(&world);
            let mut figures = Figures::default();
            for seed in 4..=if is_long { 8 } else { 4 } {
                let run = play(|file| job("explore", &robot(), (name, &text), seed, file)).run();
                let place = |time_ns, x_m, y_m| MapPoint { time_ns, x_m, y_m };
                let path: Vec<MapPoint> = run
                    .path_now()
                    .map(|(time_ns, pose)| place(time_ns, pose.x_m, pose.y_m))
                    .collect();
                let placed = run.points_now();
                let found = walls(&Sight::of(&placed, &path));
                let points: Vec<[f64; 2]> = placed.iter().map(|p| [p.x_m, p.y_m]).collect();
                figures.add(&judge(&found, &points, &truth, &samples));
                let [offset, direction] = deviations(&found, &truth);
                off[0].extend(offset);
                off[1].extend(direction);
            }
            figures.print(&format!("{name}, {echo}"));
            all.entry(echo).or_default().add(&figures);
        }
    }
    for (echo, figures) in &all {
        figures.print(&format!("all, {echo}"));
        let [precision, phantom, recall, points] = figures.shares();
        assert!(precision > 76.0 && phantom < 6.0, "{echo}: {precision} %, {phantom} %");
        assert!(recall > 0.55 * points, "{echo}: {recall} % of {points} %");
    }
    for (name, off) in ["offset", "direction"].into_iter().zip(&mut off) {
        let within = stats::share(off, |sds| sds < 2.0).unwrap() * 100.0;
        println!("  {name}: {within:.0} % within two standard deviations");
        // They do not have the drift of the pose in them: with five seeds 89 and 96 %.
        assert!(within > 70.0, "{name}: {within} %");
    }
}

#[test]
fn figures_of_walls_in_real_scans() {
    let Some(folder) = sonar::folder() else { return };
    println!("lego-rotating-sonar, walls: as in simulated rooms");
    let truth = sonar::walls(&folder);
    let samples: Vec<[f64; 2]> = truth.iter().flat_map(samples_of).collect();
    let [(_, alignment, place), _] = PLACES;
    let teams = sights_of_teams(&folder, alignment, place);
    let mut all = Figures::default();
    for (team, sights) in &teams {
        let points: Vec<[f64; 2]> = sights.iter().map(|sight| sight.at_m).collect();
        let figures = judge(&walls(sights), &points, &truth, &samples);
        figures.print(team);
        all.add(&figures);
    }
    all.print("all");
    let [precision, phantom, recall, _] = all.shares();
    assert!(precision > 75.0 && phantom < 5.0, "{precision} %, {phantom} %");
    assert!(recall > 28.0, "{recall} %");
}

#[test]
fn figures_of_what_stands_in_real_scans() {
    let Some(folder) = sonar::folder() else { return };
    let truth = sonar::walls(&folder);
    let samples: Vec<[f64; 2]> = truth.iter().flat_map(samples_of).collect();
    let judge = |places: &[[f64; 2]]| {
        let point = |[x_m, y_m]: [f64; 2]| MapPoint { time_ns: 0, x_m, y_m };
        let far_m: Vec<f64> =
            places.iter().map(|place| sonar::to_nearest_wall(&truth, point(*place))).collect();
        let near = stats::share(&far_m, |m| m < 0.05).unwrap() * 100.0;
        [near, covered(&samples, places.iter().copied(), 0.05).unwrap() * 100.0]
    };
    for (where_they_stood, alignment, place) in PLACES {
        println!(
            "lego-rotating-sonar, all places of a robot, {where_they_stood}: points, under 5 cm, \
             wall with a point, %; of what stands; turned to where several sides agree"
        );
        let mut sums = [[0.0; 2]; 3];
        for (team, sights) in sights_of_teams(&folder, alignment, place) {
            let stand: Vec<Sight> = sights
                .iter()
                .zip(standing(&sights))
                .filter_map(|(sight, stands)| stands.then_some(*sight))
                .collect();
            let [all, standing] =
                [&sights, &stand].map(|sights| sights.iter().map(|sight| sight.at_m).collect());
            let figures =
                [all, standing, crossings(&stand)].map(|places: Vec<[f64; 2]>| judge(&places));
            let [[near, coverage], [near_now, coverage_now], [turned, coverage_turned]] = figures;
            println!(
                "  {team:15} {:5} {near:5.1} {coverage:5.1}  {:5} {near_now:5.1} \
                 {coverage_now:5.1}  {turned:5.1} {coverage_turned:5.1}",
                sights.len(),
                stand.len()
            );
            assert!(near_now > near && coverage_now > 0.95 * coverage, "{team}: {figures:?}");
            assert!(coverage_turned > 0.95 * coverage_now, "{team}: {figures:?}");
            for (sum, figure) in sums.iter_mut().flatten().zip(figures.iter().flatten()) {
                *sum += figure;
            }
        }
        let [[near, _], [near_now, _], [turned, _]] = sums;
        println!("  sums {near:5.1}, {near_now:5.1}, {turned:5.1}");
        assert!(near_now > near + 5.0, "{sums:?}, sums over the robots");
        // Places that a hand is a few centimetres wrong about say nothing of where arcs cross.
        let least = if alignment == FITTED { near_now + 1.0 } else { near_now - 1.0 };
        assert!(turned > least, "{sums:?}, sums over the robots");
    }
}

/// The alignment with each robot's place as the scan says.
const FITTED: &str = "alignment_derived.csv";

/// Where a scan's robot stood.
type PlaceOf = fn(&[String]) -> Pose;

/// Where robots stood: on their marks, and as it was fitted.
const PLACES: [(&str, &str, PlaceOf); 2] = [
    ("on their marks", "alignment_nominal.csv", sonar::marked),
    ("as fitted", FITTED, sonar::fitted),
];

/// What each robot saw from all its places.
fn sights_of_teams(folder: &Path, alignment: &str, place: PlaceOf) -> BTreeMap<String, Vec<Sight>> {
    let mut teams: BTreeMap<String, Vec<Sight>> = BTreeMap::new();
    for scan in sonar::scans(folder, alignment) {
        let stood = place(&scan);
        let points = sonar::cloud(&scan, stood, &sonar::readings(folder, &scan), Method::Default);
        let from_m = [stood.x_m, stood.y_m];
        let sights = points.iter().map(|point| Sight { at_m: [point.x_m, point.y_m], from_m });
        teams.entry(scan[0].clone()).or_default().extend(sights);
    }
    teams
}

fn samples_of([x1, y1, x2, y2]: &Ends) -> Vec<[f64; 2]> {
    let count = (libm::hypot(x2 - x1, y2 - y1) / 0.02).ceil();
    let share = |step: u32| (f64::from(step) + 0.5) / count;
    let shares = (0..).map(share).take_while(|share| *share < 1.0);
    shares.map(|share| [x1 + share * (x2 - x1), y1 + share * (y2 - y1)]).collect()
}
