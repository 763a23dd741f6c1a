//! Walls as segments and discs: distances, rays, and whether a place is inside.
//!
//! # Not here
//!
//! No robots and no sensors: what a ray means is said in `sim::sensors`.
//!
//! # What we count on
//!
//! A few hundred surfaces: every query looks at all of them.

use nalgebra::Vector2;

/// A place or a direction in the plane, metres.
pub(in crate::sim) type Point = Vector2<f64>;

/// A direction turned a quarter turn anticlockwise.
pub(in crate::sim) fn perpendicular(vector: Point) -> Point {
    Point::new(-vector.y, vector.x)
}

/// The unit vector of an angle.
pub(in crate::sim) fn direction(angle_rad: f64) -> Point {
    let (sin, cos) = libm::sincos(angle_rad);
    Point::new(cos, sin)
}

/// A straight piece of wall, without thickness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::sim) struct Segment {
    pub(in crate::sim) from: Point,
    pub(in crate::sim) to: Point,
}

impl Segment {
    /// The point of the segment nearest to a place; of a segment of length 0, its start.
    pub(in crate::sim) fn closest(&self, place: Point) -> Point {
        let along = self.to - self.from;
        let square = along.norm_squared();
        if square <= 0.0 {
            return self.from;
        }
        let share = ((place - self.from).dot(&along) / square).clamp(0.0, 1.0);
        self.from + along * share
    }

    fn distance(&self, place: Point) -> f64 {
        (self.closest(place) - place).norm()
    }

    /// True where the two have a point in common; parallel ones have none.
    pub(in crate::sim) fn crosses(&self, other: &Segment) -> bool {
        let along = other.to - other.from;
        let length_m = along.norm();
        length_m > 0.0
            && self.hit(other.from, along / length_m).is_some_and(|hit| hit.range_m <= length_m)
    }

    /// Where a ray meets the segment.
    pub(in crate::sim) fn hit(&self, origin: Point, toward: Point) -> Option<Hit> {
        let along = self.to - self.from;
        let across = toward.perp(&along);
        if across.abs() < 1e-12 {
            return None;
        }
        let offset = self.from - origin;
        let range_m = offset.perp(&along) / across;
        let share = offset.perp(&toward) / across;
        if range_m < 0.0 || !(0.0..=1.0).contains(&share) {
            return None;
        }
        let cos_incidence = (across / along.norm()).abs();
        Some(Hit { range_m, cos_incidence })
    }
}

/// A round post.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::sim) struct Disc {
    pub(in crate::sim) centre: Point,
    pub(in crate::sim) radius_m: f64,
}

impl Disc {
    fn hit(&self, origin: Point, toward: Point) -> Option<Hit> {
        let offset = self.centre - origin;
        let ahead = offset.dot(&toward);
        let aside = toward.perp(&offset);
        let inside = self.radius_m * self.radius_m - aside * aside;
        if ahead < 0.0 || inside < 0.0 || offset.norm() < self.radius_m {
            return None;
        }
        let depth = libm::sqrt(inside);
        Some(Hit { range_m: ahead - depth, cos_incidence: depth / self.radius_m })
    }
}

/// Where a ray ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::sim) struct Hit {
    /// Length of the ray.
    pub(in crate::sim) range_m: f64,
    /// Cosine of the angle between the ray and the surface's normal: 1 is head-on.
    pub(in crate::sim) cos_incidence: f64,
}

/// Keeps the nearer of two hits.
pub(in crate::sim) fn nearer(one: Option<Hit>, other: Option<Hit>) -> Option<Hit> {
    match (one, other) {
        (Some(a), Some(b)) => Some(if b.range_m < a.range_m { b } else { a }),
        (a, b) => a.or(b),
    }
}

/// Where two walls meet at right angles, in whichever of its four quarters they have arms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::sim) struct Corner {
    pub(in crate::sim) place: Point,
    pub(in crate::sim) arms: [Arm; 2],
}

/// One of the walls of a corner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::sim) struct Arm {
    /// The wall's unit vector.
    pub(in crate::sim) along: Point,
    /// How far the wall reaches from the corner against `along` and with it, metres.
    pub(in crate::sim) reach_m: [f64; 2],
}

/// Walls that come as near to each other as this form a corner.
const CORNER_GAP_M: f64 = 0.02;
/// The cosine of the angle between walls at which a corner still sends the sound back: 84°.
const SQUARE_COS: f64 = 0.1;

impl Corner {
    fn of(one: &Segment, other: &Segment) -> Option<Self> {
        let [(a, a_m), (b, b_m)] = [one, other].map(|wall| {
            let along = wall.to - wall.from;
            let length_m = along.norm();
            (along / length_m.max(1e-9), length_m)
        });
        if a.dot(&b).abs() > SQUARE_COS || a_m.min(b_m) < CORNER_GAP_M {
            return None;
        }
        let across = a.perp(&b);
        let at_a = (other.from - one.from).perp(&b) / across;
        let at_b = (other.from - one.from).perp(&a) / across;
        let near = |at: f64, length_m: f64| (-CORNER_GAP_M..=length_m + CORNER_GAP_M).contains(&at);
        let arm = |along, at: f64, length_m: f64| Arm {
            along,
            reach_m: [at.max(0.0), (length_m - at).max(0.0)],
        };
        (near(at_a, a_m) && near(at_b, b_m)).then(|| Self {
            place: one.from + a * at_a,
            arms: [arm(a, at_a, a_m), arm(b, at_b, b_m)],
        })
    }
}

/// Everything that stands in a world.
#[derive(Debug, Clone, Default)]
pub(in crate::sim) struct Surfaces {
    pub(in crate::sim) segments: Vec<Segment>,
    pub(in crate::sim) discs: Vec<Disc>,
    pub(in crate::sim) corners: Vec<Corner>,
}

impl Surfaces {
    /// Adds the sides of a polyline; `closed` joins its ends.
    pub(in crate::sim) fn add_polyline(&mut self, points: &[Point], closed: bool) {
        self.segments.extend(sides(points, closed));
    }

    /// Finds the corners of all walls. Walls are sorted from left to right, so that each is
    /// compared with those only that it may meet.
    pub(in crate::sim) fn find_corners(&mut self) {
        let span = |wall: &Segment| (wall.from.x.min(wall.to.x), wall.from.x.max(wall.to.x));
        let mut walls = self.segments.clone();
        walls.sort_by(|one, other| span(one).0.total_cmp(&span(other).0));
        let mut rest = walls.as_slice();
        while let Some((wall, further)) = rest.split_first() {
            rest = further;
            let meets = |other: &&Segment| span(other).0 <= span(wall).1 + CORNER_GAP_M;
            let corners = further.iter().take_while(meets);
            self.corners.extend(corners.filter_map(|other| Corner::of(wall, other)));
        }
    }

    /// Distance from a place to the nearest surface, in metres; infinite where there is none.
    pub(in crate::sim) fn distance(&self, place: Point) -> f64 {
        let walls = self.segments.iter().map(|segment| segment.distance(place));
        let posts =
            self.discs.iter().map(|disc| ((disc.centre - place).norm() - disc.radius_m).abs());
        walls.chain(posts).fold(f64::INFINITY, f64::min)
    }

    /// The first surface that a ray meets.
    pub(in crate::sim) fn hit(&self, origin: Point, toward: Point) -> Option<Hit> {
        let wall = self
            .segments
            .iter()
            .fold(None, |best, segment| nearer(best, segment.hit(origin, toward)));
        self.discs.iter().fold(wall, |best, disc| nearer(best, disc.hit(origin, toward)))
    }
}

/// The sides of a polyline.
pub(in crate::sim) fn sides(points: &[Point], closed: bool) -> impl Iterator<Item = Segment> {
    let open = points.iter().zip(points.iter().skip(1));
    let closing = points.last().zip(points.first()).filter(move |_| closed);
    open.chain(closing).map(|(from, to)| Segment { from: *from, to: *to })
}

/// True where a place lies inside a polygon, by the count of sides that a ray to the right crosses.
pub(in crate::sim) fn contains(polygon: &[Point], place: Point) -> bool {
    let crosses = |side: &Segment| {
        (side.from.y > place.y) != (side.to.y > place.y) && {
            let share = (place.y - side.from.y) / (side.to.y - side.from.y);
            place.x < side.from.x + share * (side.to.x - side.from.x)
        }
    };
    sides(polygon, true).filter(crosses).count() % 2 == 1
}

/// The corners of a rectangle, anticlockwise.
pub(in crate::sim) fn rectangle(centre: Point, size_m: Point, turn_rad: f64) -> [Point; 4] {
    let along = direction(turn_rad) * (size_m.x / 2.0);
    let aside = perpendicular(direction(turn_rad)) * (size_m.y / 2.0);
    [centre - along - aside, centre + along - aside, centre + along + aside, centre - along + aside]
}

/// Distance from a place to a polyline, in metres.
pub(in crate::sim) fn distance_to_polyline(points: &[Point], closed: bool, place: Point) -> f64 {
    sides(points, closed).map(|side| side.distance(place)).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(x: f64, y: f64) -> Point {
        Point::new(x, y)
    }

    #[test]
    fn a_ray_meets_a_wall_head_on_and_obliquely() {
        let wall = Segment { from: at(1.0, -2.0), to: at(1.0, 2.0) };
        let head_on = wall.hit(at(0.0, 0.0), direction(0.0)).unwrap();
        assert!(
            (head_on.range_m - 1.0).abs() < 1e-12 && (head_on.cos_incidence - 1.0).abs() < 1e-12,
            "{head_on:?}"
        );
        let oblique = wall.hit(at(0.0, 0.0), direction(1.0)).unwrap();
        assert!((oblique.cos_incidence - libm::cos(1.0)).abs() < 1e-12, "{oblique:?}");
        assert_eq!(wall.hit(at(0.0, 0.0), direction(3.0)), None);
    }

    #[test]
    fn corners_are_where_walls_meet_at_right_angles() {
        let mut room = Surfaces::default();
        room.add_polyline(&[at(0.0, 0.0), at(2.0, 0.0), at(2.0, 1.0), at(0.5, 1.5)], false);
        // A wall that ends a centimetre before another.
        room.add_polyline(&[at(1.0, 0.01), at(1.0, 0.4)], false);
        room.find_corners();
        let mut places: Vec<[f64; 2]> =
            room.corners.iter().map(|corner| [corner.place.x, corner.place.y]).collect();
        places.sort_by(|one, other| one[0].total_cmp(&other[0]));
        assert_eq!(places, [[1.0, 0.0], [2.0, 0.0]]);
    }

    #[test]
    fn a_place_is_inside_a_rectangle_or_not() {
        let corners = rectangle(at(1.0, 1.0), at(2.0, 1.0), 0.5);
        assert!(contains(&corners, at(1.0, 1.0)));
        assert!(!contains(&corners, at(1.0, 1.9)));
        assert!(!contains(&[], at(0.0, 0.0)));
    }

    proptest! {
        #[test]
        fn a_ray_is_never_shorter_than_the_way_to_the_nearest_surface(
            walls in prop::collection::vec((-3.0..3.0, -3.0..3.0, -3.0..3.0, -3.0..3.0), 0..12),
            discs in prop::collection::vec((-3.0..3.0, -3.0..3.0, 0.01..0.5), 0..6),
            angle in -4.0..4.0,
        ) {
            let mut surfaces = Surfaces::default();
            for (a, b, c, d) in walls {
                surfaces.add_polyline(&[at(a, b), at(c, d)], false);
            }
            for (x, y, radius_m) in discs {
                let centre = at(x, y);
                if centre.norm() > radius_m {
                    surfaces.discs.push(Disc { centre, radius_m });
                }
            }
            if let Some(hit) = surfaces.hit(at(0.0, 0.0), direction(angle)) {
                let nearest = surfaces.distance(at(0.0, 0.0));
                prop_assert!(hit.range_m >= nearest - 1e-9, "{hit:?}, nearest {nearest}");
                prop_assert!((0.0..=1.0 + 1e-9).contains(&hit.cos_incidence), "{hit:?}");
                let end = direction(angle) * hit.range_m;
                prop_assert!(surfaces.distance(end) < 1e-6, "the ray ends in the air at {end:?}");
            }
        }
    }
}
