//! The state of pose, scales and landmarks with its covariance, and the Kalman filter's algebra.
//!
//! Simultaneous localization and mapping by an extended Kalman filter (Smith, Self and Cheeseman
//! 1990; Thrun, Burgard and Fox, *Probabilistic Robotics*, chapter 10). The state is pose, gyro
//! scale, wheel scale, and three numbers for each landmark: x, y and the direction in
//! which its surface lies from the sensor. The covariances between all of them are what brings an
//! old part of the map into order when the robot comes back to it.
//!
//! # What it costs
//!
//! [`LANDMARKS`] landmarks make 77 numbers and 3,003 covariances, in single precision: 12.3 kB. An
//! observation touches each covariance once.
//!
//! # Not here
//!
//! Which landmark an observation is of, and what it should have been (`landmarks`).

use std::array;

use arrayvec::ArrayVec;
use serde::{Deserialize, Serialize};

use super::Pose;

/// Landmarks at most. Rooms of 5 m have 10 to 24 feet; with more the cost grows with the square.
pub(super) const LANDMARKS: usize = 24;
/// Numbers of the pose, and with the scales all that are not a landmark's.
const POSE: usize = 3;
const OWN: usize = 5;
/// Numbers of a landmark.
const EACH: usize = 3;
const SIZE: usize = OWN + EACH * LANDMARKS;
const COVARIANCES: usize = SIZE * (SIZE + 1) / 2;

/// Standard deviations of the scales of gyro and wheels before anything was seen: LEGO's gyro is
/// right to ±3 % or so, `calibrate` measures wheels to one percent.
const GYRO_SCALE: f32 = 0.015;
const WHEEL_SCALE: f32 = 0.01;
/// Variance of the pose before anything moved.
const START_M2: f32 = 1e-8;
const START_RAD2: f32 = 1e-6;

/// Variance of a place after a metre, m².
const WAY_M2_M: f64 = 1e-4;
/// Variance of the heading after a radian of turn, rad²: 0.2°, the gyro's scale left out.
const TURN_RAD2_RAD: f64 = 1e-5;
/// The same after a second: 0.04°, after a minute 0.3°.
const TIME_RAD2_S: f64 = 5e-7;

/// An observation's derivatives by pose (x, y, heading) and by its landmark's three numbers, for
/// bearing and distance.
pub(super) type Jacobian = [[f32; 6]; 2];

/// Two by two, symmetric: first, mixed, second.
pub(super) type Symmetric = [f32; 3];

/// What moved the pose since the covariance was brought up to date: the derivatives of the pose by
/// what it was and by the scales, and the variance that came with the way.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
struct Passed {
    /// Of x and y by heading, gyro scale, wheel scale.
    place: [[f64; 3]; 2],
    turned_rad: f64,
    way_m2: f64,
    turn_rad2: f64,
}

/// A step of odometry, in the body's frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Step {
    pub forward_m: f64,
    pub left_m: f64,
    pub turn_rad: f64,
    pub passed_s: f64,
    /// By what a slip may have falsified it.
    pub slip_m: f64,
}

/// See the module.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Filter {
    pub pose: Pose,
    /// By how much the scales of gyro and wheels are off, 0 where they are right.
    scales: [f64; 2],
    /// x, y and direction of each landmark.
    landmarks: ArrayVec<[f64; EACH], LANDMARKS>,
    /// The lower triangle, row by row.
    covariances: ArrayVec<f32, COVARIANCES>,
    passed: Passed,
}

impl Default for Filter {
    fn default() -> Self {
        Self::new(Pose::default())
    }
}

impl Filter {
    pub(super) fn new(pose: Pose) -> Self {
        let variances =
            [START_M2, START_M2, START_RAD2, GYRO_SCALE * GYRO_SCALE, WHEEL_SCALE * WHEEL_SCALE];
        let mut covariances = ArrayVec::new();
        for (row, variance) in variances.into_iter().enumerate() {
            covariances.extend((0..row).map(|_| 0.0));
            covariances.push(variance);
        }
        Self {
            pose,
            scales: [0.0; 2],
            landmarks: ArrayVec::new(),
            covariances,
            passed: Passed::default(),
        }
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
            self.pose.x_m += x_m * (1.0 + wheel_scale);
            self.pose.y_m += y_m * (1.0 + wheel_scale);
            passed.way_m2 += WAY_M2_M * (step.forward_m.abs() + step.left_m.abs());
        }
        passed.way_m2 += step.slip_m * step.slip_m;
        self.pose.heading_rad += step.turn_rad * (1.0 + gyro_scale);
        passed.turned_rad += step.turn_rad;
        passed.turn_rad2 += TURN_RAD2_RAD * step.turn_rad.abs() + TIME_RAD2_S * step.passed_s;
    }

    /// Brings the covariances up to the pose: P' = A P Aᵀ + Q. Only the pose's rows change.
    pub(super) fn settle(&mut self) {
        let passed = std::mem::take(&mut self.passed);
        let moved = passed.transition();
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
                let noise = if row == column { noise } else { 0.0 };
                self.set(row, column, dot(by, half) + noise);
            }
        }
    }

    /// The covariance of an innovation: H P Hᵀ for the pose and one landmark.
    pub(super) fn of_innovation(&self, landmark: usize, by: &Jacobian) -> Symmetric {
        let rows = rows_of(landmark);
        let block: [[f32; 6]; 6] = rows.map(|row| rows.map(|column| self.covariance(row, column)));
        let half = by.map(|by| block.map(|row| dot(&by, &row)));
        [dot(&by[0], &half[0]), dot(&by[0], &half[1]), dot(&by[1], &half[1])]
    }

    /// Takes an observation of a landmark: what was seen less what was expected, its derivatives,
    /// and its covariance with all that is in it.
    pub(super) fn observe(
        &mut self,
        landmark: usize,
        innovation: [f32; 2],
        by: &Jacobian,
        covariance: Symmetric,
    ) {
        let Some(inverse) = inverse(covariance) else { return };
        let rows = rows_of(landmark);
        let size = self.size();
        // P Hᵀ, and the gain P Hᵀ S⁻¹.
        let mut shared: ArrayVec<[f32; 2], SIZE> = ArrayVec::new();
        for row in 0..size {
            let of = rows.map(|column| self.covariance(row, column));
            shared.push(by.map(|by| dot(&by, &of)));
        }
        for (row, [first, second]) in shared.iter().enumerate() {
            let gain = [
                first * inverse[0] + second * inverse[1],
                first * inverse[1] + second * inverse[2],
            ];
            self.shift(row, -f64::from(dot(&gain, &innovation)));
            let start = row * (row + 1) / 2;
            let Some(line) = self.covariances.get_mut(start..=start + row) else { return };
            for (value, shared) in line.iter_mut().zip(&shared) {
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
        for row in 0..EACH {
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
        let gone = OWN + EACH * landmark..OWN + EACH * (landmark + 1);
        let mut kept = 0;
        for row in (0..self.size()).filter(|row| !gone.contains(row)) {
            for column in (0..=row).filter(|column| !gone.contains(column)) {
                self.covariances[kept] = self.covariances[row * (row + 1) / 2 + column];
                kept += 1;
            }
        }
        self.covariances.truncate(kept);
        self.landmarks.remove(landmark);
    }

    /// Covariance of the pose: xx, xy, xh, yy, yh, hh.
    pub(super) fn of_pose(&self) -> [f64; 6] {
        [(0, 0), (1, 0), (2, 0), (1, 1), (2, 1), (2, 2)]
            .map(|(row, column)| f64::from(self.covariance(row, column)))
    }

    fn size(&self) -> usize {
        OWN + EACH * self.landmarks.len()
    }

    fn covariance(&self, row: usize, column: usize) -> f32 {
        self.covariances.get(place(row, column)).copied().unwrap_or(0.0)
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
            _ => match self.landmarks.get_mut((row - OWN) / EACH) {
                Some(landmark) => &mut landmark[(row - OWN) % EACH],
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

    fn noise(&self) -> [f32; OWN] {
        [self.way_m2, self.way_m2, self.turn_rad2, 0.0, 0.0].map(single)
    }
}

/// The rows of the pose and of a landmark.
fn rows_of(landmark: usize) -> [usize; 6] {
    let at = OWN + EACH * landmark;
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
