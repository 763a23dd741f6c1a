//! The state of pose, scales and landmarks with its covariance, and the Kalman filter's algebra.
//!
//! Simultaneous localization and mapping by an extended Kalman filter (Smith, Self and Cheeseman
//! 1990; Thrun, Burgard and Fox, *Probabilistic Robotics*, chapter 10). The state is pose, gyro
//! scale, wheel scale, three numbers for each keyframe (`keyframes`), and three for each landmark:
//! x, y and the direction in which its surface lies from the sensor. The covariances between all of
//! them are what brings an old part of the map into order when the robot comes back to it.
//!
//! # What it costs
//!
//! [`LANDMARKS`] landmarks and [`KEYFRAMES`] keyframes make 83 numbers and 3,486 covariances, in
//! single precision: 14.3 kB. An observation touches each covariance once.
//!
//! # The gyro's bias
//!
//! is no number of the state (`landmarks` says what came of that), but what the state would be with
//! another bias is carried along: each number's derivative by it, which steps and observations
//! change by the same formulas as the covariances. So a bias that is found late
//! ([`Filter::rebias`]) puts pose and landmarks where they would be had it been known. What is long
//! past fades ([`BIAS_MEMORY_S`]): a drift need not be as old as the run.
//!
//! By the same derivatives each innovation says something of the bias: what it would be with
//! another one ([`Filter::bias`]; Friedland, *Treatment of bias in recursive filtering*, 1969).
//!
//! # Not here
//!
//! Which landmark an observation is of, and what it should have been (`landmarks`).

use std::array;

use arrayvec::ArrayVec;
use serde::{Deserialize, Serialize};

use super::drift::Information;
use super::uncertainty::{self, Covariance};
use super::{Geometry, Pose};

/// Landmarks at most. Rooms of 5 m have 10 to 24 feet; with more the cost grows with the square.
pub(super) const LANDMARKS: usize = 20;
/// Poses of the way that are kept at most (`keyframes`).
pub(super) const KEYFRAMES: usize = 6;
/// Numbers of the pose, and with the scales all that are not a landmark's.
const POSE: usize = 3;
const OWN: usize = 5;
/// Numbers of a landmark, and of a keyframe.
const EACH: usize = 3;
/// The row of the first landmark, after those of the keyframes.
const FIRST: usize = OWN + EACH * KEYFRAMES;
const SIZE: usize = FIRST + EACH * LANDMARKS;
const COVARIANCES: usize = SIZE * (SIZE + 1) / 2;

/// Standard deviation of the wheels' scale before anything was seen: `calibrate` measures wheels to
/// one percent.
const WHEEL_SCALE: f32 = 0.01;
/// Variance of the pose before anything moved.
const START_M2: f32 = 1e-8;
const START_RAD2: f32 = 1e-6;

/// Variance of a metre's way, along it, m²: the mean of two wheels that are each right to 1 cm
/// (`uncertainty`). What lies beside the way comes from the heading.
const WAY_M2_M: f64 = 5e-5;
/// Variance of the heading after a radian of turn, rad²: 0.2°, the gyro's scale left out.
const TURN_RAD2_RAD: f64 = 1e-5;
/// The same after a second: 0.04°, after a minute 0.3°.
const TIME_RAD2_S: f64 = 5e-7;

/// How long what a bias did is remembered, seconds: one that is followed may change.
const BIAS_MEMORY_S: f64 = 80.0;

/// An innovation's derivatives by pose (x, y, heading) and by its landmark's three numbers, for
/// bearing and distance.
pub(super) type Jacobian = [[f32; 6]; 2];

/// Two by two, symmetric: first, mixed, second.
pub(super) type Symmetric = [f32; 3];

/// What moved the pose since the covariance was brought up to date: the derivatives of the pose by
/// what it was and by the scales, and the covariance that came with the way.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
struct Passed {
    /// Of x and y by heading, gyro scale, wheel scale.
    place: [[f64; 3]; 2],
    /// Of x and y by the gyro's bias.
    by_bias: [f64; 2],
    turned_rad: f64,
    /// How long the gyro's bias was in the turn.
    biased_s: f64,
    /// What came with the way.
    noise: Covariance,
}

/// A step of odometry, in the body's frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Step {
    pub forward_m: f64,
    pub left_m: f64,
    pub turn_rad: f64,
    pub passed_s: f64,
    /// Whether the turn is the gyro's, and its bias in it.
    pub by_gyro: bool,
    /// By what a slip may have falsified it.
    pub slip_m: f64,
}

/// See the module.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Filter {
    pub pose: Pose,
    /// By how much the scales of gyro and wheels are off, 0 where they are right.
    scales: [f64; 2],
    /// Poses of the way: never observed, corrected with all else.
    keyframes: [[f64; EACH]; KEYFRAMES],
    /// x, y and direction of each landmark.
    landmarks: ArrayVec<[f64; EACH], LANDMARKS>,
    /// The lower triangle, row by row.
    covariances: ArrayVec<f32, COVARIANCES>,
    /// Derivatives of all numbers by the gyro's bias, a second.
    by_bias: ArrayVec<f32, SIZE>,
    /// What the innovations have said of the bias.
    bias: Information,
    passed: Passed,
}

impl Default for Filter {
    fn default() -> Self {
        Self::new(Pose::default(), Geometry::GYRO_SCALE_SD)
    }
}

impl Filter {
    /// A filter whose gyro counts right to a share.
    pub(super) fn new(pose: Pose, gyro_scale_sd: f64) -> Self {
        let gyro_scale_2 = single(gyro_scale_sd * gyro_scale_sd);
        let variances = [START_M2, START_M2, START_RAD2, gyro_scale_2, WHEEL_SCALE * WHEEL_SCALE];
        let mut covariances = ArrayVec::new();
        for (row, variance) in variances.into_iter().enumerate() {
            covariances.extend((0..row).map(|_| 0.0));
            covariances.push(variance);
        }
        covariances.extend((covariances.len()..FIRST * (FIRST + 1) / 2).map(|_| 0.0));
        Self {
            pose,
            scales: [0.0; 2],
            keyframes: [[0.0; EACH]; KEYFRAMES],
            landmarks: ArrayVec::new(),
            covariances,
            by_bias: ArrayVec::from_iter([0.0; FIRST]),
            bias: Information::default(),
            passed: Passed::default(),
        }
    }

    /// Keeps the pose as it is in a slot: from here on it is corrected like a landmark.
    pub(super) fn keep_pose(&mut self, slot: usize) {
        self.settle();
        let Pose { x_m, y_m, heading_rad } = self.pose;
        let Some(keyframe) = self.keyframes.get_mut(slot) else { return };
        *keyframe = [x_m, y_m, heading_rad];
        let first = OWN + EACH * slot;
        let own = first..first + EACH;
        for row in 0..POSE {
            for column in (0..self.size()).filter(|column| !own.contains(column)) {
                self.set(first + row, column, self.covariance(row, column));
            }
            for column in 0..=row {
                self.set(first + row, first + column, self.covariance(row, column));
            }
            let by_bias = self.bias_derivative(row);
            if let Some(kept) = self.by_bias.get_mut(first + row) {
                *kept = by_bias;
            }
        }
    }

    /// The pose in a slot as it is known now.
    pub(super) fn kept_pose(&self, slot: usize) -> Pose {
        let [x_m, y_m, heading_rad] = self.keyframes.get(slot).copied().unwrap_or_default();
        Pose { x_m, y_m, heading_rad }
    }

    /// x, y and direction of a landmark.
    pub(super) fn landmark(&self, index: usize) -> [f64; EACH] {
        self.landmarks.get(index).copied().unwrap_or_default()
    }

    /// Moves the pose by a step of odometry in the body's frame, corrected by the scales known so
    /// far.
    pub(super) fn step(&mut self, step: &Step) {
        let [gyro_scale, wheel_scale] = self.scales;
        let passed = &mut self.passed;
        if step.forward_m != 0.0 || step.left_m != 0.0 {
            let (sin, cos) = libm::sincos(self.pose.heading_rad);
            let x_m = cos * step.forward_m - sin * step.left_m;
            let y_m = sin * step.forward_m + cos * step.left_m;
            for (by, [across_m, along_m]) in passed.place.iter_mut().zip([[-y_m, x_m], [x_m, y_m]])
            {
                by[0] += across_m;
                by[1] += across_m * passed.turned_rad;
                by[2] += along_m;
            }
            passed.by_bias[0] += y_m * passed.biased_s;
            passed.by_bias[1] -= x_m * passed.biased_s;
            self.pose.x_m += x_m * (1.0 + wheel_scale);
            self.pose.y_m += y_m * (1.0 + wheel_scale);
            let way_m2 = WAY_M2_M * step.forward_m.abs();
            passed.noise = uncertainty::moved(passed.noise, [x_m, y_m], [cos, sin], way_m2);
        }
        let slip_m2 = step.slip_m * step.slip_m;
        passed.noise[0] += slip_m2;
        passed.noise[3] += slip_m2;
        self.pose.heading_rad += step.turn_rad * (1.0 + gyro_scale);
        passed.turned_rad += step.turn_rad;
        passed.biased_s += if step.by_gyro { step.passed_s } else { 0.0 };
        passed.noise[5] += TURN_RAD2_RAD * step.turn_rad.abs() + TIME_RAD2_S * step.passed_s;
    }

    /// Brings the covariances up to the pose: P' = A P Aᵀ + Q. Only the pose's rows change.
    pub(super) fn settle(&mut self) {
        let passed = std::mem::take(&mut self.passed);
        let moved = passed.transition();
        let faded = 1.0 - single((passed.biased_s / BIAS_MEMORY_S).min(1.0));
        self.by_bias.iter_mut().for_each(|value| *value *= faded);
        self.bias.fade(f64::from(faded));
        let own: [f32; OWN] = array::from_fn(|row| self.bias_derivative(row));
        for ((value, by), came) in self.by_bias.iter_mut().zip(&moved).zip(passed.came_by_bias()) {
            *value = dot(by, &own) + came;
        }
        let block: [[f32; OWN]; OWN] =
            array::from_fn(|row| array::from_fn(|column| self.covariance(row, column)));
        for column in OWN..self.size() {
            let of: [f32; OWN] = array::from_fn(|row| self.covariance(row, column));
            for (row, by) in moved.iter().enumerate().take(POSE) {
                self.set(row, column, dot(by, &of));
            }
        }
        let half = moved
            .map(|by| array::from_fn(|column| dot(&by, &array::from_fn(|row| block[row][column]))));
        let noise = passed.noise();
        for (row, (half, noise)) in half.iter().zip(noise).enumerate() {
            for (column, by) in moved.iter().enumerate().take(row + 1) {
                let noise = noise.get(column).copied().unwrap_or(0.0);
                self.set(row, column, dot(by, half) + noise);
            }
        }
    }

    /// Puts pose and landmarks where they would be if the gyro's bias had been known to be greater
    /// by this, rad/s. What landmarks have said of it was of another one.
    pub(super) fn rebias(&mut self, by_rad_s: f64) {
        self.settle();
        for row in 0..self.size() {
            self.shift(row, f64::from(self.bias_derivative(row)) * by_rad_s);
        }
        self.bias = Information::default();
    }

    /// What landmarks have said of the gyro's bias, beyond the one that is being removed.
    pub(super) fn bias(&self) -> Information {
        self.bias
    }

    /// Forgets what the bias has done so far: it was another one, or is made up for.
    pub(super) fn forget_bias(&mut self) {
        self.settle();
        self.by_bias.fill(0.0);
        self.bias = Information::default();
    }

    /// The covariance of an innovation: H P Hᵀ for the pose and one landmark.
    pub(super) fn of_innovation(&self, landmark: usize, by: &Jacobian) -> Symmetric {
        let rows = rows_of(landmark);
        let half =
            by.map(|by| rows.map(|row| dot(&by, &rows.map(|column| self.covariance(row, column)))));
        [dot(&by[0], &half[0]), dot(&by[0], &half[1]), dot(&by[1], &half[1])]
    }

    /// Takes an observation of a landmark: the innovation (what was seen less what was
    /// expected), its derivatives, and its covariance with all that is in it.
    pub(super) fn observe(
        &mut self,
        landmark: usize,
        innovation: [f32; 2],
        by: &Jacobian,
        covariance: Symmetric,
    ) {
        let Some(inverse) = inverse(covariance) else { return };
        let rows = rows_of(landmark);
        let shared = (0..self.size()).map(|row| {
            let of = rows.map(|column| self.covariance(row, column));
            by.map(|by| dot(&by, &of))
        });
        let shared = shared.collect();
        let by_bias = by.map(|by| dot(&by, &rows.map(|row| self.bias_derivative(row))));
        // With a bias that is greater by b the innovation would be greater by `by_bias` b.
        let weights = [[inverse[0], inverse[1]], [inverse[1], inverse[2]]];
        let weights = weights.map(|row| dot(&row, &by_bias));
        self.bias.weighted -= f64::from(dot(&weights, &innovation));
        self.bias.weight += f64::from(dot(&weights, &by_bias));
        self.update(&shared, innovation, by_bias, inverse);
    }

    /// Takes a measurement of the share by which the gyro's scale is off.
    ///
    /// - `deviation`: of that, a standard deviation.
    pub(super) fn observe_gyro_scale(&mut self, off: f64, deviation: f64) {
        self.settle();
        let innovation = [single(off - self.scales[0]), 0.0];
        let variance = self.covariance(POSE, POSE) + single(deviation * deviation);
        let shared = (0..self.size()).map(|row| [-self.covariance(row, POSE), 0.0]).collect();
        let by_bias = [-self.bias_derivative(POSE), 0.0];
        self.update(&shared, innovation, by_bias, [1.0 / variance, 0.0, 0.0]);
    }

    /// The Kalman filter's update.
    ///
    /// - `shared`: P Hᵀ, the covariance of each number with the innovation.
    /// - `by_bias`: the innovation's derivatives by the gyro's bias.
    /// - `inverse`: of the innovation's covariance, S⁻¹.
    fn update(
        &mut self,
        shared: &ArrayVec<[f32; 2], SIZE>,
        innovation: [f32; 2],
        by_bias: [f32; 2],
        inverse: Symmetric,
    ) {
        for (row, [first, second]) in shared.iter().enumerate() {
            let gain = [
                first * inverse[0] + second * inverse[1],
                first * inverse[1] + second * inverse[2],
            ];
            self.shift(row, -f64::from(dot(&gain, &innovation)));
            if let Some(value) = self.by_bias.get_mut(row) {
                *value -= dot(&gain, &by_bias);
            }
            let start = row * (row + 1) / 2;
            let Some(line) = self.covariances.get_mut(start..=start + row) else { return };
            for (value, shared) in line.iter_mut().zip(shared) {
                *value -= dot(&gain, shared);
            }
        }
    }

    /// Adds a landmark: its three numbers, their derivatives by the pose, and the covariance of
    /// what was measured besides. The caller made room.
    pub(super) fn add(
        &mut self,
        landmark: [f64; EACH],
        by_pose: [[f32; POSE]; EACH],
        measured: [[f32; EACH]; EACH],
    ) {
        if self.landmarks.is_full() {
            return;
        }
        let size = self.size();
        let mut shared = [[0.0; SIZE]; EACH];
        for (by, shared) in by_pose.iter().zip(&mut shared) {
            for (column, value) in shared.iter_mut().enumerate().take(size) {
                *value = dot(by, &array::from_fn(|row| self.covariance(row, column)));
            }
        }
        self.landmarks.push(landmark);
        let pose_by_bias: [f32; POSE] = array::from_fn(|at| self.bias_derivative(at));
        for row in 0..EACH {
            self.by_bias.push(dot(&by_pose[row], &pose_by_bias));
            self.covariances.extend(shared[row].iter().copied().take(size));
            for column in 0..=row {
                let of_pose: [f32; POSE] = array::from_fn(|at| shared[row][at]);
                self.covariances.push(dot(&by_pose[column], &of_pose) + measured[row][column]);
            }
        }
    }

    /// Forgets a landmark.
    pub(super) fn remove(&mut self, landmark: usize) {
        if landmark >= self.landmarks.len() {
            return;
        }
        let gone = FIRST + EACH * landmark..FIRST + EACH * (landmark + 1);
        let mut kept = 0;
        for row in (0..self.size()).filter(|row| !gone.contains(row)) {
            for column in (0..=row).filter(|column| !gone.contains(column)) {
                self.covariances[kept] = self.covariances[row * (row + 1) / 2 + column];
                kept += 1;
            }
        }
        self.covariances.truncate(kept);
        self.by_bias.drain(gone);
        self.landmarks.remove(landmark);
    }

    /// Covariance of the pose when it was last brought up to date: xx, xy, xh, yy, yh, hh.
    pub(super) fn of_pose(&self) -> [f64; 6] {
        [(0, 0), (1, 0), (2, 0), (1, 1), (2, 1), (2, 2)]
            .map(|(row, column)| f64::from(self.covariance(row, column)))
    }

    /// Whether it has this number of landmarks, and their covariances.
    pub(super) fn is_of(&self, landmarks: usize) -> bool {
        let size = self.size();
        self.landmarks.len() == landmarks
            && self.covariances.len() == size * (size + 1) / 2
            && self.by_bias.len() == size
    }

    fn size(&self) -> usize {
        FIRST + EACH * self.landmarks.len()
    }

    fn covariance(&self, row: usize, column: usize) -> f32 {
        self.covariances.get(place(row, column)).copied().unwrap_or(0.0)
    }

    fn bias_derivative(&self, row: usize) -> f32 {
        self.by_bias.get(row).copied().unwrap_or(0.0)
    }

    fn set(&mut self, row: usize, column: usize, value: f32) {
        if let Some(covariance) = self.covariances.get_mut(place(row, column)) {
            *covariance = value;
        }
    }

    fn shift(&mut self, row: usize, by: f64) {
        let number = match row {
            0 => &mut self.pose.x_m,
            1 => &mut self.pose.y_m,
            2 => &mut self.pose.heading_rad,
            POSE..OWN => &mut self.scales[row - POSE],
            OWN..FIRST => &mut self.keyframes[(row - OWN) / EACH][(row - OWN) % EACH],
            _ => match self.landmarks.get_mut((row - FIRST) / EACH) {
                Some(landmark) => &mut landmark[(row - FIRST) % EACH],
                None => return,
            },
        };
        *number += by;
    }
}

impl Passed {
    /// Derivatives of pose and scales by what they were.
    fn transition(&self) -> [[f32; OWN]; OWN] {
        let mut rows: [[f32; OWN]; OWN] =
            array::from_fn(|row| array::from_fn(|column| f32::from(u8::from(row == column))));
        for (row, by) in rows.iter_mut().zip(self.place) {
            for (value, by) in row.iter_mut().skip(2).zip(by) {
                *value = single(by);
            }
        }
        rows[2][3] = single(self.turned_rad);
        rows
    }

    /// What came to the derivatives of the pose by the gyro's bias.
    fn came_by_bias(&self) -> [f32; POSE] {
        let [x, y] = self.by_bias;
        [x, y, -self.biased_s].map(single)
    }

    /// The rows of what came with the way, up to the diagonal.
    fn noise(&self) -> [[f32; POSE]; OWN] {
        let [xx, xy, xh, yy, yh, hh] = self.noise.map(single);
        let none = [0.0; POSE];
        [[xx, 0.0, 0.0], [xy, yy, 0.0], [xh, yh, hh], none, none]
    }
}

/// The rows of the pose and of a landmark.
fn rows_of(landmark: usize) -> [usize; 6] {
    let at = FIRST + EACH * landmark;
    [0, 1, 2, at, at + 1, at + 2]
}

/// Where the lower triangle has this covariance.
fn place(row: usize, column: usize) -> usize {
    let (row, column) = if row < column { (column, row) } else { (row, column) };
    row * (row + 1) / 2 + column
}

fn dot<const N: usize>(one: &[f32; N], other: &[f32; N]) -> f32 {
    one.iter().zip(other).map(|(one, other)| one * other).sum()
}

/// The inverse of a covariance of two; `None` where it is none.
pub(super) fn inverse([first, mixed, second]: Symmetric) -> Option<Symmetric> {
    let determinant = first * second - mixed * mixed;
    (determinant > 0.0 && determinant.is_finite())
        .then(|| [second / determinant, -mixed / determinant, first / determinant])
}

/// For what is small: covariances and innovations.
#[expect(clippy::cast_possible_truncation, reason = "rounded")]
pub(super) fn single(number: f64) -> f32 {
    number as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A place seen from the true pose: bearing and distance, less what the filter expects, with
    /// the derivatives of that.
    fn of_point(
        filter: &Filter,
        landmark: usize,
        truth: &Pose,
        place: [f64; 2],
    ) -> ([f32; 2], Jacobian) {
        let see = |pose: &Pose, place: [f64; 2]| {
            let to = [place[0] - pose.x_m, place[1] - pose.y_m];
            (libm::atan2(to[1], to[0]) - pose.heading_rad, libm::hypot(to[0], to[1]))
        };
        let [x_m, y_m, _] = filter.landmark(landmark);
        let (seen, expected) = (see(truth, place), see(&filter.pose, [x_m, y_m]));
        let [x, y] = [(x_m - filter.pose.x_m) / expected.1, (y_m - filter.pose.y_m) / expected.1];
        let [nx, ny] = [-y / expected.1, x / expected.1];
        let by = [[nx, ny, 1.0, -nx, -ny, 0.0], [x, y, 0.0, -x, -y, 0.0]];
        let innovation = [crate::units::wrap_rad(seen.0 - expected.0), seen.1 - expected.1];
        (innovation.map(single), by.map(|row| row.map(single)))
    }

    fn observe(filter: &mut Filter, landmark: usize, truth: &Pose, place: [f64; 2]) {
        filter.settle();
        let (innovation, by) = of_point(filter, landmark, truth, place);
        let [bearing, mixed, distance] = filter.of_innovation(landmark, &by);
        filter.observe(landmark, innovation, &by, [bearing + 1e-4, mixed, distance + 1e-4]);
    }

    const PLACES: [[f64; 2]; 3] = [[2.0, 0.5], [0.5, 2.0], [-1.0, -1.0]];
    const NONE: [[f32; 3]; 3] = [[0.0; 3]; 3];

    /// A filter at the origin that knows three places exactly.
    fn knows_places() -> Filter {
        let mut filter = Filter::default();
        for [x_m, y_m] in PLACES {
            filter.add([x_m, y_m, 0.0], [[0.0; 3]; 3], NONE);
        }
        filter
    }

    #[test]
    fn scales_of_gyro_and_wheels_are_learnt_from_what_stands_still() {
        let (gyro_off, wheels_off) = (0.02, -0.015);
        let mut filter = knows_places();
        let mut odometry = Filter::default();
        let mut truth = Pose::default();
        for tick in 0..3000 {
            let (forward_m, turn_rad) = (0.002, 0.006);
            let (sin, cos) = libm::sincos(truth.heading_rad);
            truth.x_m += cos * forward_m * (1.0 + wheels_off);
            truth.y_m += sin * forward_m * (1.0 + wheels_off);
            truth.heading_rad += turn_rad * (1.0 + gyro_off);
            let step = Step { forward_m, turn_rad, passed_s: 0.01, ..Step::default() };
            filter.step(&step);
            odometry.step(&step);
            if tick % 50 == 0 {
                observe(&mut filter, tick / 50 % 3, &truth, PLACES[tick / 50 % 3]);
            }
        }
        let off_m = |pose: &Pose| libm::hypot(pose.x_m - truth.x_m, pose.y_m - truth.y_m);
        assert!(off_m(&filter.pose) < 0.01, "{:?}, not {truth:?}", filter.pose);
        assert!((filter.pose.heading_rad - truth.heading_rad).abs() < 0.01);
        assert!(off_m(&odometry.pose) > 0.05, "odometry alone: {:?}", odometry.pose);
        let [gyro, wheels] = filter.scales;
        assert!((gyro - gyro_off).abs() < 0.003, "gyro {gyro}");
        assert!((wheels - wheels_off).abs() < 0.006, "wheels {wheels}");
    }

    #[test]
    fn a_scale_that_is_measured_turns_back_what_it_has_turned_too_far() {
        let mut filter = Filter::default();
        filter.step(&Step { turn_rad: 10.0, passed_s: 10.0, by_gyro: true, ..Step::default() });
        filter.step(&Step { forward_m: 1.0, ..Step::default() });
        filter.observe_gyro_scale(-0.03, 0.001);
        assert!((filter.scales[0] + 0.03).abs() < 1e-3, "{:?}", filter.scales);
        let Pose { x_m, y_m, heading_rad } = filter.pose;
        assert!((heading_rad - 9.7).abs() < 0.01, "{heading_rad}");
        let (sin, cos) = libm::sincos(9.7);
        // What is corrected is linear: a turn of 0.3 rad leaves 4 cm of a metre.
        assert!(libm::hypot(x_m - cos, y_m - sin) < 0.05, "{x_m}, {y_m}");
        filter.step(&Step { turn_rad: 1.0, ..Step::default() });
        assert!((filter.pose.heading_rad - heading_rad - 0.97).abs() < 1e-3);
    }

    #[test]
    fn steps_settled_one_by_one_and_together_come_to_the_same() {
        let (mut one_by_one, mut together) = (knows_places(), knows_places());
        for tick in 0..200 {
            let turn_rad = if tick % 40 < 20 { 0.01 } else { -0.004 };
            let step = Step {
                forward_m: 0.003,
                turn_rad,
                passed_s: 0.01,
                slip_m: 1e-5,
                left_m: 1e-4,
                by_gyro: true,
            };
            one_by_one.step(&step);
            one_by_one.settle();
            together.step(&step);
        }
        together.settle();
        let (one, other) = (one_by_one.of_pose(), together.of_pose());
        for (at, [row, column]) in
            [[0, 0], [0, 3], [0, 5], [3, 3], [3, 5], [5, 5]].iter().enumerate()
        {
            let most = 1e-3 * libm::sqrt(one[*row] * one[*column]);
            assert!((one[at] - other[at]).abs() < most, "{one:?} {other:?}");
        }
        assert_eq!(one_by_one.pose, together.pose);
    }

    #[test]
    fn a_pose_that_is_kept_is_corrected_by_what_is_seen_later() {
        let (gyro_off, step_s) = (0.03, 0.01);
        let mut filter = knows_places();
        let mut truth = Pose::default();
        let mut drive = |filter: &mut Filter, ticks: usize| {
            for _ in 0..ticks {
                let (forward_m, turn_rad) = (0.002, 0.006);
                let (sin, cos) = libm::sincos(truth.heading_rad);
                truth.x_m += cos * forward_m;
                truth.y_m += sin * forward_m;
                truth.heading_rad += turn_rad * (1.0 + gyro_off);
                let passed_s = step_s;
                filter.step(&Step { forward_m, turn_rad, passed_s, ..Step::default() });
            }
            truth
        };
        let there = drive(&mut filter, 300);
        filter.keep_pose(2);
        assert_eq!(filter.kept_pose(2), filter.pose);
        let off = |pose: &Pose, truth: &Pose| {
            let off_m = libm::hypot(pose.x_m - truth.x_m, pose.y_m - truth.y_m);
            (off_m, (pose.heading_rad - truth.heading_rad).abs())
        };
        let (was_m, was_rad) = off(&filter.kept_pose(2), &there);
        for (landmark, place) in PLACES.into_iter().enumerate() {
            let here = drive(&mut filter, 50);
            observe(&mut filter, landmark, &here, place);
        }
        let (now_m, now_rad) = off(&filter.kept_pose(2), &there);
        assert!(
            now_m < 0.4 * was_m && now_rad < 0.3 * was_rad,
            "{was_m} {was_rad}: {now_m} {now_rad}"
        );
        assert_eq!(filter.kept_pose(1), Pose::default(), "nothing was kept there");
        filter.keep_pose(9);
    }

    #[test]
    fn a_bias_that_is_found_late_leaves_what_it_would_have_left_had_it_been_known() {
        const BIAS_RAD_S: f64 = 0.02;
        let run = |known_rad_s: f64| {
            let mut filter = Filter::default();
            let mut truth = Pose::default();
            for tick in 0..400_usize {
                let (forward_m, turn_rad) = (0.002, if tick % 100 < 50 { 0.01 } else { -0.006 });
                let (sin, cos) = libm::sincos(truth.heading_rad);
                truth.x_m += cos * forward_m;
                truth.y_m += sin * forward_m;
                truth.heading_rad += turn_rad;
                let turn_rad = turn_rad + (BIAS_RAD_S - known_rad_s) * 0.01;
                let step =
                    Step { forward_m, turn_rad, passed_s: 0.01, by_gyro: true, ..Step::default() };
                filter.step(&step);
                match tick {
                    60 | 120 | 180 => {
                        filter.settle();
                        let [x_m, y_m] = PLACES[tick / 60 - 1];
                        // As if it had been seen from where the robot believes to be.
                        let by = [
                            [1.0, 0.0, single(filter.pose.y_m - y_m)],
                            [0.0, 1.0, single(x_m - filter.pose.x_m)],
                            [0.0, 0.0, 1.0],
                        ];
                        let off_rad = filter.pose.heading_rad - truth.heading_rad;
                        let (sin, cos) = libm::sincos(off_rad);
                        let to = [x_m - truth.x_m, y_m - truth.y_m];
                        let x_m = filter.pose.x_m + cos * to[0] - sin * to[1];
                        let y_m = filter.pose.y_m + sin * to[0] + cos * to[1];
                        let measured = [[1e-4, 0.0, 0.0], [0.0, 1e-4, 0.0], [0.0, 0.0, 1e-4]];
                        filter.add([x_m, y_m, off_rad], by, measured);
                    }
                    250 | 300 | 350 => {
                        let place = tick / 50 - 5;
                        observe(&mut filter, place, &truth, PLACES[place]);
                    }
                    _ => {}
                }
            }
            filter
        };
        let numbers = |filter: &Filter| {
            let Pose { x_m, y_m, heading_rad } = filter.pose;
            let mut numbers = vec![x_m, y_m, heading_rad];
            numbers.extend((0..3).flat_map(|at| filter.landmark(at)));
            numbers
        };
        let (mut late, known) = (run(0.0), run(BIAS_RAD_S));
        let (before, after) = (numbers(&late), numbers(&known));
        let most = before.iter().zip(&after).map(|(one, other)| (one - other).abs());
        let most = most.fold(0.0, f64::max);
        assert!(most > 0.02, "the bias has done something: {most}");
        late.rebias(BIAS_RAD_S);
        for (late, known) in numbers(&late).iter().zip(&after) {
            assert!((late - known).abs() < 0.15 * most, "{late}, not {known}: {before:?}");
        }
        late.forget_bias();
        let before = numbers(&late);
        late.rebias(BIAS_RAD_S);
        assert_eq!(numbers(&late), before, "it is forgotten");
    }

    #[test]
    fn a_landmark_that_is_forgotten_leaves_the_others_as_they_are() {
        let by_pose = [[1.0, 0.0, 0.5], [0.0, 1.0, 2.0], [0.0, 0.0, 1.0]];
        let measured = [[1e-3, 0.0, 0.0], [0.0, 2e-3, 0.0], [0.0, 0.0, 3e-3]];
        let filled = |landmarks: &[f64]| {
            let mut filter = Filter::default();
            for x_m in landmarks {
                filter.add([*x_m, 1.0, 0.0], by_pose, measured);
            }
            filter
        };
        let mut filter = filled(&[1.0, 2.0, 3.0]);
        filter.remove(1);
        assert_eq!(filter, filled(&[1.0, 3.0]));
        filter.remove(7);
        assert_eq!(filter, filled(&[1.0, 3.0]), "there is no eighth");
    }

    #[test]
    fn an_observation_makes_what_it_is_of_more_certain() {
        let mut filter = Filter::default();
        filter.step(&Step { forward_m: 1.0, turn_rad: 1.0, passed_s: 5.0, ..Step::default() });
        filter.settle();
        filter.add([2.0, 0.5, 0.0], [[0.0; 3]; 3], NONE);
        let before = filter.of_pose();
        let truth = Pose { x_m: 1.0, y_m: 0.0, heading_rad: 1.01 };
        observe(&mut filter, 0, &truth, [2.0, 0.5]);
        let after = filter.of_pose();
        for variance in [0, 3, 5] {
            assert!(after[variance] <= before[variance], "{before:?} {after:?}");
            assert!(after[variance] > 0.0, "{after:?}");
        }
        assert!(after[5] < 0.5 * before[5], "{before:?} {after:?}");
    }
}
