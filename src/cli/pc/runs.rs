//! `onbrick runs`: which recordings bricks have.

use super::remote::{Bricks, Unnamed, conclude};
use crate::cli::{Failure, Output};
use crate::protocol::RunInfo;
use crate::units::counted;

/// List the runs on bricks' disks, the newest first.
///
/// Examples:
///   onbrick runs ev3-blue
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    bricks: Bricks,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let asking = arguments.bricks.asking(Unnamed::All)?;
    let answers = asking.ask(|client, _| client.runs());
    conclude(answers, output, |output, brick, runs| {
        if runs.runs.is_empty() {
            output.line(format!("{}: no run is there yet", brick.name));
        }
        for run in &runs.runs {
            output.line(format!("{}  {}", brick.name, line(run)));
        }
        output.value(&serde_json::json!({ "brick": brick.name, "runs": runs.runs }));
    })
}

#[expect(clippy::cast_precision_loss, reason = "a size for people")]
fn line(run: &RunInfo) -> String {
    let metres = run.travelled_m.map(|metres| format!("  {metres:.1} m")).unwrap_or_default();
    let points =
        run.points.map(|points| format!("  {}", counted(points, "point"))).unwrap_or_default();
    let end = match &run.end {
        Some(end) => end.stop.reason.to_string(),
        None if run.going_on => "going on".to_owned(),
        None => "cut".to_owned(),
    };
    let fetched = if run.fetched { "  fetched" } else { "" };
    let megabytes = run.bytes as f64 / 1e6;
    format!("{}  {}  {megabytes:.1} MB{metres}{points}  {end}{fetched}", run.run, run.mission)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_has_one_point_or_several() {
        let of = |points| {
            line(
                &serde_json::from_value(serde_json::json!({
                    "run": "map-1", "mission": "map", "number": 1, "bytes": 1_000_000,
                    "going_on": true, "fetched": false, "end": null, "travelled_m": 0.5,
                    "points": points,
                }))
                .unwrap(),
            )
        };
        assert_eq!(of(Some(1)), "map-1  map  1.0 MB  0.5 m  1 point  going on");
        assert_eq!(of(Some(2)), "map-1  map  1.0 MB  0.5 m  2 points  going on");
        assert_eq!(of(None), "map-1  map  1.0 MB  0.5 m  going on");
    }
}
