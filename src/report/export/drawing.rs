//! Walls as a drawing for CAD: DXF, release 12, lines alone.
//!
//! Written here and not by crate `dxf` (0.6.2), which reads and writes all of the format: a line is
//! eight pairs of code and value, and release 12 wants little around them.

use std::fmt::Write;

use crate::mapping::Wall;

/// The layer that the lines are on.
const LAYER: &str = "WALLS";

/// Walls as lines of a drawing in metres, x to the right, y up. Release 12 says nothing of units,
/// so a comment does.
///
/// # Source
///
/// Autodesk, *DXF Reference*, AC1009: group codes, sections, `LINE`.
#[must_use]
pub fn dxf(walls: &[Wall]) -> String {
    let mut text = String::from(
        "999\nonbrick: walls, 1 unit = 1 metre\n0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1009\n0\n\
         ENDSEC\n0\nSECTION\n2\nENTITIES\n",
    );
    for Wall { from_m: [x1, y1], to_m: [x2, y2], .. } in walls {
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "0\nLINE\n8\n{LAYER}\n10\n{x1:.4}\n20\n{y1:.4}\n30\n0.0\n11\n{x2:.4}\n21\n{y2:.4}\n31\n0.0\n"
        );
    }
    text.push_str("0\nENDSEC\n0\nEOF\n");
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_wall_is_a_line_of_pairs_of_code_and_value() {
        let wall = Wall { from_m: [0.0, -0.5], to_m: [1.25, 2.0], ..Wall::default() };
        let text = dxf(&[wall, wall]);
        let lines: Vec<&str> = text.lines().collect();
        let (pairs, rest) = lines.as_chunks::<2>();
        assert!(rest.is_empty() && pairs.iter().all(|[code, _]| code.parse::<u16>().is_ok()));
        let values = |code: &str| {
            pairs.iter().filter(|pair| pair[0] == code).map(|pair| pair[1]).collect::<Vec<_>>()
        };
        assert_eq!(values("0").iter().filter(|value| **value == "LINE").count(), 2);
        assert_eq!([values("10")[0], values("20")[0]], ["0.0000", "-0.5000"]);
        assert_eq!([values("11")[1], values("21")[1]], ["1.2500", "2.0000"]);
        assert!(dxf(&[]).ends_with("0\nENDSEC\n0\nEOF\n"));
    }
}
