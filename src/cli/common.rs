//! What several commands do: find a file by path or by name, load a robot, a mission or a world.

use std::path::Path;

use super::{Exit, Failure, Output};
use crate::behavior::{Capabilities, Mission};
use crate::document::{Document, Findings};
use crate::robot::{DEFAULT_ROBOT, RobotConfig};
use crate::runtime::Source;

/// A robot's file as it was read, and what it says.
#[derive(Debug)]
pub(super) struct LoadedRobot {
    pub(super) source: Source,
    pub(super) config: RobotConfig,
}

/// Reads a file; a name without a folder or an ending may also be that of a text we carry.
pub(super) fn read_source(
    path: &Path,
    carried: impl Fn(&str) -> Option<&'static str>,
) -> Result<Source, Failure> {
    let name = path.to_string_lossy();
    if let Some(text) = carried(&name).filter(|_| !path.exists()) {
        return Ok(Source { name: format!("{name}.toml"), text: text.to_owned() });
    }
    let bytes = read_bounded(path)?;
    let document =
        Document::new(&name, &bytes).map_err(|findings| Failure::refused(findings.to_string()))?;
    Ok(Source { name: name.into_owned(), text: document.text().to_owned() })
}

/// Reads at most one byte more than a document may have: enough to say that it is too long.
fn read_bounded(path: &Path) -> Result<Vec<u8>, Failure> {
    let failed = |error: &std::io::Error| {
        Failure::from_error(Exit::Refused, &format!("cannot read {}", path.display()), error)
    };
    let file = std::fs::File::open(path).map_err(|error| failed(&error))?;
    let mut bytes = Vec::new();
    let most = u64::try_from(Document::MAX_BYTES + 1).unwrap_or(u64::MAX);
    std::io::Read::read_to_end(&mut std::io::Read::take(file, most), &mut bytes)
        .map_err(|error| failed(&error))?;
    Ok(bytes)
}

/// Loads a robot's file, or the shipped one; warnings go to the log.
pub(super) fn load_robot(path: Option<&Path>, _output: &mut Output) -> Result<LoadedRobot, Failure> {
    let source = match path {
        Some(path) => read_source(path, |_| None)?,
        None => Source { name: "robot.toml".to_owned(), text: DEFAULT_ROBOT.to_owned() },
    };
    let (config, warnings) = RobotConfig::load(&source.name, source.text.as_bytes())
        .map_err(|findings| Failure::refused(findings.to_string()))?;
    warn(&warnings);
    Ok(LoadedRobot { source, config })
}

/// Loads a mission for a robot.
pub(super) fn load_mission(
    source: &Source,
    capabilities: &Capabilities,
) -> Result<(Mission, Findings), Findings> {
    Mission::load(&source.name, source.text.as_bytes(), capabilities)
}

/// Puts warnings to the log: the file can be used all the same.
pub(super) fn warn(findings: &Findings) {
    for finding in findings {
        log::warn!("{finding}");
    }
}

/// `name=value` of `--set`.
pub(super) fn setting(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.split_once('=').ok_or("it is written name=value")?;
    let value: f64 = value.parse().map_err(|_| format!("`{value}` is not a number"))?;
    if value.is_finite() { Ok((name.to_owned(), value)) } else { Err("the number must be finite".to_owned()) }
}

/// `x,y,deg` of `--pose`: metres, metres, degrees.
pub(super) fn pose(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse::<f64>()).collect();
    let numbers = numbers.map_err(|_| "a pose is x,y,deg: metres, metres, degrees")?;
    let pose: [f64; 3] = numbers.try_into().map_err(|_| "a pose has three numbers: x,y,deg")?;
    /// Poses farther away than this are slips of the pen.
    const FARTHEST: f64 = 1e6;
    if pose.iter().all(|number| number.abs() <= FARTHEST) { Ok(pose) } else { Err("a pose's numbers are small and finite".to_owned()) }
}
