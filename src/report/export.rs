//! Runs for other people's programs: CSV, PLY, DXF, PGM with Nav2's YAML, MCAP with an index.

mod drawing;
mod indexed;

use std::fmt::Write;

use super::Track;
use crate::clock::seconds;
use crate::mapping::Wall;
use crate::printable;
use crate::recording::Grid;
use crate::units::degrees;

pub use drawing::dxf;
pub use indexed::{ExportError, NamedRecording, mcap};

/// The points of all tracks: `time_s,x_m,y_m,robot`.
#[must_use]
pub fn points_csv(tracks: &[Track]) -> String {
    let mut text = String::from("time_s,x_m,y_m,robot\n");
    for track in tracks {
        let name = csv_text(&track.name);
        for point in &track.points {
            // Writing to a string cannot fail.
            let time_s = seconds(point.time_ns);
            let _ = writeln!(text, "{time_s:.6},{:.6},{:.6},{name}", point.x_m, point.y_m);
        }
    }
    text
}

/// The paths of all tracks, every tick: `time_s,x_m,y_m,heading_deg,robot`; the heading does not
/// wrap.
#[must_use]
pub fn path_csv(tracks: &[Track]) -> String {
    let mut text = String::from("time_s,x_m,y_m,heading_deg,robot\n");
    for track in tracks {
        let name = csv_text(&track.name);
        for p in &track.path {
            let (time_s, heading_deg) = (seconds(p.time_ns), degrees(p.heading_rad));
            let _ = writeln!(text, "{time_s:.6},{:.6},{:.6},{heading_deg:.4},{name}", p.x_m, p.y_m);
        }
    }
    text
}

/// Walls, the best first: `x1_m,y1_m,x2_m,y2_m,length_m,direction_deg,offset_sd_m,`
/// `direction_sd_deg,points`; both standard deviations are of the line, across itself at its middle
/// and of its direction.
#[must_use]
pub fn walls_csv(walls: &[Wall]) -> String {
    let mut text = String::from(
        "x1_m,y1_m,x2_m,y2_m,length_m,direction_deg,offset_sd_m,direction_sd_deg,points\n",
    );
    for wall in walls {
        let ([x1, y1], [x2, y2]) = (wall.from_m, wall.to_m);
        let direction_deg = degrees(libm::atan2(y2 - y1, x2 - x1));
        let direction_sd_deg = degrees(wall.direction_sd_rad);
        let (length_m, offset_sd_m, points) = (wall.length_m(), wall.offset_sd_m, wall.points);
        let _ = writeln!(
            text,
            "{x1:.4},{y1:.4},{x2:.4},{y2:.4},{length_m:.4},{direction_deg:.2},{offset_sd_m:.4},\
             {direction_sd_deg:.2},{points}"
        );
    }
    text
}

/// The points of all tracks as a point cloud in the Stanford polygon format, each with its robot's
/// place in the list.
#[must_use]
pub fn ply(tracks: &[Track]) -> String {
    let count: usize = tracks.iter().map(|track| track.points.len()).sum();
    let mut text = String::from("ply\nformat ascii 1.0\ncomment onbrick, metres, z up\n");
    for (place, track) in tracks.iter().enumerate() {
        let name = printable::line(&track.name);
        let _ = writeln!(text, "comment robot {place}: {name}");
    }
    let _ = write!(
        text,
        "element vertex {count}\nproperty double x\nproperty double y\nproperty double z\n\
         property double time_s\n\
         property ushort robot\nend_header\n"
    );
    for (place, track) in tracks.iter().enumerate() {
        for point in &track.points {
            let time_s = seconds(point.time_ns);
            let _ = writeln!(text, "{:.6} {:.6} 0 {time_s:.6} {place}", point.x_m, point.y_m);
        }
    }
    text
}

/// An occupied cell at least so sure, as Nav2 writes it.
const OCCUPIED_THRESHOLD: f64 = 0.65;
/// A free cell at most so sure ([`Grid::is_free`]). Grey 205, by which Nav2's own tools write
/// "unknown", is 0.19607…: it must lie above.
const FREE_THRESHOLD: f64 = 0.196;

/// A comment that tells a map of ours from those of other programs, which have the same names.
const MADE_BY: &str = "# onbrick\n";

/// The grid as a picture (PGM, binary): black occupied, 254 free, 205 unknown; the highest y first,
/// as Nav2 reads it.
#[must_use]
pub fn pgm(grid: &Grid) -> Vec<u8> {
    let mut bytes = format!("P5\n{MADE_BY}{} {}\n255\n", grid.width, grid.height).into_bytes();
    let width = usize::try_from(grid.width).unwrap_or(usize::MAX).max(1);
    for row in grid.cells.chunks(width).rev() {
        bytes.extend(row.iter().map(|cell| grey(*cell)));
    }
    bytes
}

/// What Nav2 has to know of that picture; `image` is its file's name.
#[must_use]
pub fn nav2_yaml(grid: &Grid, image: &str) -> String {
    let [x, y] = grid.origin_m;
    // A JSON string is a YAML string.
    let image = serde_json::Value::from(image);
    format!(
        "{MADE_BY}image: {image}\nmode: trinary\nresolution: {:?}\n\
         origin: [{x:?}, {y:?}, 0.0]\nnegate: 0\n\
         occupied_thresh: {OCCUPIED_THRESHOLD}\nfree_thresh: {FREE_THRESHOLD}\n",
        grid.resolution_m
    )
}

/// A cell's grey: what lies between the thresholds is unknown.
fn grey(cell: i8) -> u8 {
    if Grid::is_free(cell) {
        254
    } else if f64::from(cell) / 100.0 >= OCCUPIED_THRESHOLD {
        0
    } else {
        205
    }
}

/// Text as a field of CSV (RFC 4180); one that a spreadsheet would take for a formula gets an
/// apostrophe before it.
pub(super) fn csv_text(text: &str) -> String {
    let text =
        if text.starts_with(['=', '+', '-', '@']) { format!("'{text}") } else { text.to_owned() };
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_break_a_table() {
        assert_eq!(csv_text("mapper"), "mapper");
        assert_eq!(csv_text("a,\"b\""), "\"a,\"\"b\"\"\"");
        assert_eq!(csv_text("=1+1"), "'=1+1");
    }

    #[test]
    fn nav2_reads_back_what_was_meant() {
        // Nav2's map_io, trinary: occ = (255 − grey) / 255; above occupied_thresh occupied, below
        // free_thresh free.
        let read = |cell: i8| {
            let occupancy = (255.0 - f64::from(grey(cell))) / 255.0;
            if occupancy > OCCUPIED_THRESHOLD {
                100
            } else if occupancy < FREE_THRESHOLD {
                0
            } else {
                -1
            }
        };
        assert_eq!([-1, 0, 10, 50, 64, 65, 100].map(read), [-1, 0, 0, -1, -1, 100, 100]);
    }

    #[test]
    fn empty_input_gives_headers_alone() {
        assert_eq!(points_csv(&[]), "time_s,x_m,y_m,robot\n");
        assert_eq!(path_csv(&[]), "time_s,x_m,y_m,heading_deg,robot\n");
        assert!(ply(&[]).ends_with("end_header\n"));
        assert_eq!(pgm(&Grid::default()), b"P5\n# onbrick\n0 0\n255\n");
    }
}
