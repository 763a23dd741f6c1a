//! The folder of a run that is recorded here.

use std::path::{Path, PathBuf};

use super::{Context, Exit, Failure, Hint};

/// A run's recording, in its folder.
const RECORDING: &str = "run.mcap";

/// What is drawn of runs, beside their recording.
#[cfg(feature = "host")]
pub(super) const DRAWN: [&str; 4] = ["map.svg", "map.png", "points.csv", "path.csv"];

/// A map as ROS's map server reads it.
#[cfg(feature = "host")]
pub(super) const GRID: [&str; 2] = ["map.pgm", "map.yaml"];

/// A recording's own folder.
pub(super) struct RunFolder {
    pub(super) path: PathBuf,
    /// The recording's name in it.
    name: &'static str,
    /// The folders that were created, the innermost first.
    made: Vec<PathBuf>,
}

impl RunFolder {
    /// The folder that a person names, or the next free one of a mission: `onbrick-runs/map-1`,
    /// `map-2` and so on. A brick's clock may stand at 1970, so no dates.
    pub(super) fn of_mission(out: Option<&Path>, mission: &str) -> Result<Self, Failure> {
        let sign = |sign: char| if sign.is_alphanumeric() || sign == '-' { sign } else { '_' };
        let plain: String = mission.chars().map(sign).collect();
        let candidate = |number| numbered(&Path::new("onbrick-runs").join(&plain), number);
        Self::make(out, RECORDING, &[], candidate)
    }

    /// The folder that a person names, or the next free one of the demo's: `onbrick-demo`,
    /// `onbrick-demo-2` and so on.
    #[cfg(feature = "host")]
    pub(super) fn of_demo(out: Option<&Path>) -> Result<Self, Failure> {
        Self::make(out, RECORDING, &DRAWN, |number| first_plain("onbrick-demo", number))
    }

    /// The folder that a person names, or the next free one of teams: `onbrick-team`,
    /// `onbrick-team-2` and so on.
    #[cfg(feature = "host")]
    pub(super) fn of_team(out: Option<&Path>) -> Result<Self, Failure> {
        let more = [DRAWN.as_slice(), &GRID].concat();
        Self::make(out, "team.mcap", &more, |number| first_plain("onbrick-team", number))
    }

    /// Creates the folder if missing; refuses one whose path is not UTF-8, and one in which
    /// something is there already of what is going to be written: the recording, and `more`.
    fn make(
        out: Option<&Path>,
        name: &'static str,
        more: &[&str],
        candidate: impl Fn(u32) -> PathBuf,
    ) -> Result<Self, Failure> {
        let next_free = || (1..).map(candidate).find(|folder| !folder.exists()).unwrap_or_default();
        let folder = out.map_or_else(next_free, Path::to_owned);
        let named = folder.ancestors().filter(|folder| !folder.as_os_str().is_empty());
        let made = named.take_while(|folder| !folder.exists()).map(Path::to_owned).collect();
        let path = std::fs::create_dir_all(&folder).and_then(|()| folder.canonicalize());
        let path = path
            .context(Exit::Refused, format_args!("cannot make {}", folder.display()))
            .hint("--out with a folder that can be written to")?;
        let run_folder = Self { path, name, made };
        // The processes of a run tell each other its place in JSON, which is UTF-8.
        if run_folder.path.to_str().is_none() {
            run_folder.take_back();
            let place = run_folder.path.display();
            return Err(Failure::usage(format!("the path {place} is not UTF-8"))
                .hint("--out with a folder whose whole path is UTF-8"));
        }
        let mut files =
            [&[name][..], more].concat().into_iter().map(|name| run_folder.path.join(name));
        match files.find(|file| file.exists()) {
            Some(file) => Err(Failure::refused(format!("{} is there already", file.display()))
                .hint("another folder for --out: what is there is never written over")),
            None => Ok(run_folder),
        }
    }

    /// Where the recording goes.
    pub(super) fn file(&self) -> PathBuf {
        self.path.join(self.name)
    }

    /// A run that was refused leaves no empty folder. One that is not empty stays.
    pub(super) fn take_back(&self) {
        for folder in &self.made {
            let _ = std::fs::remove_dir(folder);
        }
    }
}

/// The first free one of `path-2`, `path-3` and so on: for one more run with the same `--out`.
#[cfg(feature = "host")]
pub(super) fn next_to(path: &Path) -> PathBuf {
    (2..).map(|number| numbered(path, number)).find(|path| !path.exists()).unwrap_or_default()
}

#[cfg(feature = "host")]
fn first_plain(name: &str, number: u32) -> PathBuf {
    if number == 1 { name.into() } else { numbered(Path::new(name), number) }
}

fn numbered(path: &Path, number: u32) -> PathBuf {
    let mut numbered = path.as_os_str().to_owned();
    numbered.push(format!("-{number}"));
    numbered.into()
}

#[cfg(all(test, feature = "host"))]
mod tests {
    use super::*;

    #[test]
    fn each_run_without_a_name_gets_a_folder_of_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let team = folder.path().join("team");
        let make = || {
            let candidate = |number| first_plain(team.to_str().unwrap(), number);
            RunFolder::make(None, "team.mcap", &DRAWN, candidate)
        };
        for name in ["team", "team-2", "team-3"] {
            let made = make().unwrap();
            assert_eq!(made.path, folder.path().canonicalize().unwrap().join(name));
            std::fs::write(made.file(), "").unwrap();
        }
        let refused = RunFolder::of_team(Some(&team)).err().unwrap();
        assert!(refused.message.ends_with("team/team.mcap is there already"), "{refused:?}");
    }

    #[test]
    fn what_would_be_drawn_over_after_the_run_refuses_the_folder_before_it() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("points.csv"), "x,y\n").unwrap();
        for refused in [RunFolder::of_team, RunFolder::of_demo] {
            let refused = refused(Some(folder.path())).err().unwrap();
            assert!(refused.message.ends_with("points.csv is there already"), "{refused:?}");
        }
        assert!(RunFolder::of_mission(Some(folder.path()), "map").is_ok());
    }

    #[test]
    fn a_path_that_is_not_utf_8_is_refused_and_nothing_is_left_there() {
        use std::os::unix::ffi::OsStrExt as _;
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join(std::ffi::OsStr::from_bytes(b"\xff"));
        let refused = RunFolder::of_mission(Some(&out), "map").err().unwrap();
        assert!(refused.exit == Exit::Usage && !out.exists(), "{refused:?}");
    }
}
