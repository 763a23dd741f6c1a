//! What a recording says of itself, as one line of JSON: `run run.mcap`.
//!
//! For the emulated brick's scenarios: how late its ticks were, how far into the run it goes, and
//! whether all of it was checked.

use std::path::Path;

use onbrick::recording::Run;

pub(crate) fn run(path: &str) -> Result<(), Box<dyn std::error::Error>> {
    let run = Run::open(Path::new(path))?;
    let period_ns = run.info.as_ref().map_or(20_000_000, |info| info.period_ns);
    // A tick's time is counted from the first, and its deadline is a whole number of periods.
    let mut late_ns: Vec<i64> =
        run.senses.iter().map(|senses| senses.time_ns % period_ns).collect();
    late_ns.sort_unstable();
    let share = |hundredths: usize| {
        late_ns.get((late_ns.len() * hundredths / 100).min(late_ns.len().saturating_sub(1)))
    };
    let figures = serde_json::json!({
        "ticks": run.senses.len(),
        "last_synced_ms": run.senses.last().map(|senses| senses.time_ns / 1_000_000),
        "missed": run.statistics.iter().map(|second| u64::from(second.overruns)).sum::<u64>(),
        "late_p50_us": share(50).map(|ns| ns / 1000),
        "late_p99_us": share(99).map(|ns| ns / 1000),
        "late_max_us": run
            .statistics
            .iter()
            .map(|second| second.lateness_max_ns)
            .max()
            .map(|ns| ns / 1000),
        "points": run.points.len(),
        "ended": run.ending.map(|ending| ending.stop.to_string()),
        "integrity": format!("{:?}", run.integrity),
        "damaged": run.integrity.damaged.len(),
        "warnings": run.warnings,
    });
    println!("{figures}");
    Ok(())
}
