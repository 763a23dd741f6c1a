//! The simulated ultrasonic sensor against real ones: the scans of `lego-rotating-sonar` made once
//! more in a simulated arena, from the places that were fitted to them.
//!
//! Both go through the same mapper, from the same printed marks. What is compared is what the
//! mapper gains by placing echoes within the cone, and what a scan looks like: whose distance an
//! echo is when the nearest wall's foot is so far off the axis, how wide the plateaus are, how
//! often the echo comes and goes. The old model (`echo = "cone"`) is judged beside it and must
//! fail.

use std::fmt::Write as _;
use std::path::Path;

use onbrick::mapping::{Method, Pose, stats};
use onbrick::sim::{Physics as _, StartPose, World, WorldPhysics};
use onbrick::units::{degrees, wrap_rad};

use super::sonar::{self, Reading, Wall, number};

/// How the scans of one sensor look, shares unless it says otherwise.
#[derive(Debug, Clone, Copy)]
struct Look {
    /// Points under 5 cm: on the axis, and as the default places them.
    under_5_cm: [f64; 2],
    /// Readings at the distance of the nearest foot, by its angle off the axis: 0 to 10, 10 to 20,
    /// 20 to 30, 30 to 40°.
    foot: [f64; 4],
    /// Readings without an echo, by the same angles.
    missed: [f64; 4],
    /// What of a turn lies in plateaus narrower than 10, 20, 40°.
    narrow: [f64; 3],
    /// Changes between echo and none, a turn.
    changes: f64,
}

impl Look {
    fn gain(&self) -> f64 {
        self.under_5_cm[1] - self.under_5_cm[0]
    }

    /// What differs from another's look, and by how much it may; empty for a good model.
    fn differs(&self, real: &Self) -> Vec<String> {
        let worst = |one: &[f64], other: &[f64]| {
            one.iter().zip(other).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        [
            ("gain", (self.gain() - real.gain()).abs(), 0.03),
            ("plain cloud", (self.under_5_cm[0] - real.under_5_cm[0]).abs(), 0.05),
            ("echoes of feet", worst(&self.foot, &real.foot), 0.10),
            ("misses", worst(&self.missed, &real.missed), 0.10),
            ("plateaus", worst(&self.narrow, &real.narrow), 0.10),
            ("changes", (self.changes - real.changes).abs(), 5.0),
        ]
        .into_iter()
        .filter(|(_, off, most)| off > most)
        .map(|(name, off, most)| format!("{name}: off by {off:.3}, at most {most}"))
        .collect()
    }
}

#[test]
fn the_simulated_sensor_hears_what_real_ones_heard() {
    let Some(folder) = sonar::folder() else { return };
    println!("lego-rotating-sonar, real and simulated (% of points under 5 cm: plain, default)");
    let teams = ["team01", "team02", "team03"];
    let scans = Scans::read(&folder);
    let real = scans.look("", |_, readings| readings.to_vec());
    for team in teams {
        scans.look(team, |_, readings| readings.to_vec()).print(&format!("real, {team}"));
    }
    real.print("real, all");
    let mean = |echo: &str, team: &str| {
        let looks = [1, 2, 3]
            .map(|seed| scans.look(team, |at, readings| scans.simulated(at, readings, echo, seed)));
        Look::mean(&looks)
    };
    for team in teams {
        mean("lobe", team).print(&format!("lobe, {team}"));
    }
    let [lobe, cone] = ["lobe", "cone"].map(|echo| {
        let look = mean(echo, "");
        look.print(&format!("{echo}, all"));
        look
    });
    assert_eq!(lobe.differs(&real), Vec::<String>::new(), "the default model");
    let cones = cone.differs(&real);
    println!("  the cone differs in {cones:?}");
    assert!(cones.len() >= 3, "the bounds tell no bad model from a good one: {cones:?}");
}

/// All scans, with the places where they were truly made.
struct Scans {
    walls: Vec<Wall>,
    /// Rows of the nominal and of the fitted alignment, and the readings.
    scans: Vec<(Vec<String>, Vec<String>, Vec<Reading>)>,
}

impl Scans {
    fn read(folder: &Path) -> Self {
        let fitted = sonar::scans(folder, "alignment_derived.csv");
        let scans = sonar::scans(folder, "alignment_nominal.csv")
            .into_iter()
            .map(|scan| {
                let of_it = |row: &&Vec<String>| row[..2] == scan[..2];
                let fitted = fitted.iter().find(of_it).expect("a fit").clone();
                let readings = sonar::readings(folder, &scan);
                (scan, fitted, readings)
            })
            .collect();
        Self { walls: sonar::walls(folder), scans }
    }

    /// Where the sensor was at a reading of a scan, and where it looked: metres and radians.
    fn sensor(fitted: &[String], reading: &Reading) -> ([f64; 2], f64) {
        let ahead_m = if sonar::turns_whole(fitted) { sonar::TEAM_1_AHEAD_M } else { 0.0 };
        let Pose { x_m, y_m, heading_rad } = sonar::fitted(fitted);
        let axis_rad = heading_rad + reading.turned_rad;
        ([x_m + ahead_m * libm::cos(axis_rad), y_m + ahead_m * libm::sin(axis_rad)], axis_rad)
    }

    /// The same scan by a simulated sensor, in whole centimetres as those robots read.
    fn simulated(&self, at: usize, readings: &[Reading], echo: &str, seed: u64) -> Vec<Reading> {
        let fitted = &self.scans[at].1;
        let mut text = "name = \"scans\"\n".to_owned();
        for [x1, y1, x2, y2] in &self.walls {
            writeln!(text, "[[wall]]\npoints = [[{x1}, {y1}], [{x2}, {y2}]]").unwrap();
        }
        let bias_m = number(fitted, 9) / 100.0;
        writeln!(
            text,
            "[[start]]\nat = [1.05, 0.4]\n[robot]\nrange_ahead_m = 0.0\necho = \"{echo}\"\n\
             [robot.errors]\nrange_bias_m = {bias_m}"
        )
        .unwrap();
        let world = World::parse("scans", text.as_bytes()).unwrap_or_else(|e| panic!("{e}")).0;
        let seed = seed * 1000 + u64::try_from(at).unwrap();
        let mut physics = WorldPhysics::new(world, 1, seed).unwrap();
        let mut measure = |reading: &Reading| {
            let ([x_m, y_m], heading_rad) = Self::sensor(fitted, reading);
            physics.carry(0, StartPose { x_m, y_m, heading_rad });
            let [tenths, ..] = physics.measure(0, 0, "US-DIST-CM");
            let range_m = (f64::from(tenths) / 10.0).round() / 100.0;
            Reading { range_m: (tenths < 2550).then_some(range_m), ..*reading }
        };
        readings.iter().map(&mut measure).collect()
    }

    /// How the scans of a team look when a sensor has made them.
    fn look(&self, team: &str, sensor: impl Fn(usize, &[Reading]) -> Vec<Reading>) -> Look {
        let mut errors = [Vec::new(), Vec::new()];
        let mut kinds = [[0.0; 3]; 4];
        let (mut changes, mut turns) = (0.0, 0.0);
        let mut widths = Vec::new();
        for (at, (scan, fitted, readings)) in self.scans.iter().enumerate() {
            if !scan[0].starts_with(team) {
                continue;
            }
            let readings = sensor(at, readings);
            for (errors, method) in errors.iter_mut().zip([Method::Seed, Method::Default]) {
                let points = sonar::cloud(scan, sonar::marked(scan), &readings, method);
                errors.extend(
                    points.into_iter().map(|point| sonar::to_nearest_wall(&self.walls, point)),
                );
            }
            let bias_m = number(fitted, 9) / 100.0;
            for reading in &readings {
                let (place, axis_rad) = Self::sensor(fitted, reading);
                let Some((off_rad, foot_m)) = self.foot(place, axis_rad) else { continue };
                let bins = [10.0, 20.0, 30.0, 40.0].iter().zip(&mut kinds);
                let Some((_, [all, foot, missed])) =
                    bins.into_iter().find(|(most, _)| degrees(off_rad) < **most)
                else {
                    continue;
                };
                *all += 1.0;
                let beyond_m = reading.range_m.map(|range_m| range_m - bias_m - foot_m);
                *foot += f64::from(beyond_m.is_some_and(|m| (-0.04..0.06).contains(&m)));
                *missed += f64::from(beyond_m.is_none());
            }
            turns += 1.0;
            changes += f64::from(changed(&readings));
            widths.extend(plateaus(&readings));
        }
        let swept: f64 = widths.iter().sum();
        let narrower =
            |than_deg: f64| widths.iter().filter(|width| **width < than_deg).sum::<f64>() / swept;
        Look {
            under_5_cm: errors.map(|errors| stats::share(&errors, |m| m < 0.05).unwrap()),
            foot: kinds.map(|[all, foot, _]| foot / all),
            missed: kinds.map(|[all, _, missed]| missed / all),
            narrow: [10.0, 20.0, 40.0].map(narrower),
            changes: changes / turns,
        }
    }

    /// The wall's foot that is least off the axis, of those in sight: its angle and distance.
    fn foot(&self, [x, y]: [f64; 2], axis_rad: f64) -> Option<(f64, f64)> {
        let foot = |&[x1, y1, x2, y2]: &Wall| {
            let (dx, dy) = (x2 - x1, y2 - y1);
            let along = ((x - x1) * dx + (y - y1) * dy) / (dx * dx + dy * dy);
            let [fx, fy] = [x1 + along * dx, y1 + along * dy];
            let hidden =
                |wall: &Wall| crosses(*wall, [x, y, x + 0.99 * (fx - x), y + 0.99 * (fy - y)]);
            let off_rad = wrap_rad(libm::atan2(fy - y, fx - x) - axis_rad).abs();
            ((0.0..=1.0).contains(&along) && !self.walls.iter().any(hidden))
                .then(|| (off_rad, libm::hypot(fx - x, fy - y)))
        };
        self.walls.iter().filter_map(foot).min_by(|one, other| one.0.total_cmp(&other.0))
    }
}

/// Whether two straight lines cross.
fn crosses([ax, ay, bx, by]: Wall, [cx, cy, dx, dy]: Wall) -> bool {
    let side = |x: f64, y: f64, [px, py, qx, qy]: Wall| (qx - px) * (y - py) - (qy - py) * (x - px);
    let (one, other) = ([ax, ay, bx, by], [cx, cy, dx, dy]);
    side(cx, cy, one) * side(dx, dy, one) < 0.0 && side(ax, ay, other) * side(bx, by, other) < 0.0
}

/// How often an echo comes or goes.
fn changed(readings: &[Reading]) -> i32 {
    let change = |pair: &&[Reading]| pair[0].range_m.is_some() != pair[1].range_m.is_some();
    i32::try_from(readings.windows(2).filter(change).count()).unwrap()
}

/// The widths of what has the same range from reading to reading, to a centimetre: degrees.
fn plateaus(readings: &[Reading]) -> Vec<f64> {
    let mut widths = Vec::new();
    for pair in readings.windows(2) {
        let (Some(before_m), Some(range_m)) = (pair[0].range_m, pair[1].range_m) else {
            widths.push(0.0);
            continue;
        };
        if (range_m - before_m).abs() > 0.0101 || widths.is_empty() {
            widths.push(0.0);
        }
        *widths.last_mut().unwrap() += degrees((pair[1].turned_rad - pair[0].turned_rad).abs());
    }
    widths
}

impl Look {
    fn mean(looks: &[Self]) -> Self {
        let count = looks.len() as f64;
        let mean = |of: &dyn Fn(&Self) -> f64| looks.iter().map(of).sum::<f64>() / count;
        Self {
            under_5_cm: std::array::from_fn(|at| mean(&|look| look.under_5_cm[at])),
            foot: std::array::from_fn(|at| mean(&|look| look.foot[at])),
            missed: std::array::from_fn(|at| mean(&|look| look.missed[at])),
            narrow: std::array::from_fn(|at| mean(&|look| look.narrow[at])),
            changes: mean(&|look| look.changes),
        }
    }

    fn print(&self, name: &str) {
        let percent = |shares: &[f64]| {
            shares
                .iter()
                .map(|share| format!("{:3.0}", share * 100.0))
                .collect::<Vec<_>>()
                .join(" ")
        };
        println!(
            "  {name:13} {} gain {:4.1}; foot {}, missed {} at 0-10-20-30-40 deg; plateaus under \
             10, 20, 40 deg {}; {:4.1} changes",
            percent(&self.under_5_cm),
            self.gain() * 100.0,
            percent(&self.foot),
            percent(&self.missed),
            percent(&self.narrow),
            self.changes
        );
    }
}
