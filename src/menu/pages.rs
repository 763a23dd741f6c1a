//! What stands on each page.

use super::canvas::Canvas;
use super::sheet::{Sheet, View};
#[cfg(any(test, feature = "host"))]
use super::text::plain;
use super::{Menu, Notice, Page, Showing, StartedBy, Tab};
use crate::clock::seconds;
use crate::mapping::Range;
use crate::protocol::{
    LastStop, LiveDevice, MissionInfo, Pairing, RunId, RunInfo, RunStatus, State,
};
use crate::units::counted;

impl Menu {
    /// Draws what is on the screen.
    pub(super) fn draw(&self, canvas: &mut Canvas) {
        if let Some(track) = self.map_on_screen() {
            let running = self.seen.run().filter(|run| run.run == track.run);
            let pose = running.and_then(|run| run.progress.as_ref()).map(|progress| progress.pose);
            track.draw(canvas, &self.map_title(), &self.corner, pose);
            return;
        }
        self.sheet().draw(canvas, self.view(), &self.corner);
    }

    fn map_on_screen(&self) -> Option<&super::Track> {
        let shows = match self.showing() {
            Showing::Running => self.shows_map,
            Showing::Page => matches!(self.page, Some(Page::Map(_))),
            _ => false,
        };
        let run = self.mapped_run().filter(|_| shows)?;
        self.track.as_ref().filter(|track| track.run == run)
    }

    fn map_title(&self) -> String {
        match &self.page {
            Some(Page::Map(run)) if self.showing() == Showing::Page => self
                .run_info(run)
                .map_or_else(|| "Map".to_owned(), |known| format!("Run {}", known.number)),
            _ => "Map".to_owned(),
        }
    }

    /// The run that has ended and whose map can be shown.
    pub(super) fn ended_map(&self) -> Option<&RunId> {
        let last = self.ended.as_ref().filter(|last| last.is_wanted() && self.has_driven)?;
        last.run.as_ref()
    }

    /// What the list of runs says of one.
    pub(super) fn run_info(&self, run: &RunId) -> Option<&RunInfo> {
        self.seen.runs.as_ref()?.runs.iter().find(|known| known.run == *run)
    }

    /// The page on the screen as data; a map's as well, for transcripts.
    pub(super) fn sheet(&self) -> Sheet {
        match (self.showing(), &self.page) {
            (Showing::Talk, _) => self.talk.as_ref().map(super::Talk::sheet).unwrap_or_default(),
            (Showing::NoService, _) => self.no_service(),
            (Showing::Running, _) => self.running(),
            (Showing::Notice, _) => {
                self.notice.as_ref().map(|notice| self.notice_sheet(notice)).unwrap_or_default()
            }
            (Showing::Ended, _) => self
                .ended
                .as_ref()
                .map(|last| ended(last, self.ended_map().is_some()))
                .unwrap_or_default(),
            (Showing::Page, Some(Page::Mission(name))) => self.mission(name),
            (Showing::Page, Some(Page::Port(port))) => self.port(port),
            (Showing::Page, Some(Page::TimeLimit(limit_s))) => time_limit(*limit_s),
            (Showing::Page, Some(Page::Pairing)) => pairing(self.seen.pairing.as_ref()),
            (Showing::Page, Some(Page::Map(_))) => Sheet::new("Map").line("reading the map..."),
            (Showing::Tab | Showing::Page, _) => match self.tab {
                Tab::Missions => self.missions(),
                Tab::Runs => self.runs(),
                Tab::Ports => self.ports(),
                Tab::SetUp => self.set_up(),
                Tab::Settings => self.settings(),
            }
            .turning(),
        }
    }

    /// What stands where a list would, until it is there.
    fn waiting(&self, title: &'static str) -> Sheet {
        Sheet::new(title).line(self.seen.refused.as_deref().unwrap_or("looking..."))
    }

    /// Where a person is on the page on the screen.
    pub(super) fn view(&self) -> View {
        match self.showing() {
            Showing::Talk => self.talk.as_ref().map(|talk| talk.view).unwrap_or_default(),
            Showing::Tab => self.tab_views[self.tab as usize],
            other => self.views[other as usize],
        }
    }

    fn no_service(&self) -> Sheet {
        let sheet = Sheet::new("onbrick");
        match &self.seen.gone {
            None => sheet.line("Waiting for the service..."),
            Some(why) => sheet.big("No service").line(why).line(
                "Trying again. What was running stops by itself, or continues, as the brick is \
                 configured.",
            ),
        }
    }

    fn missions(&self) -> Sheet {
        let Some(missions) = &self.seen.missions else { return self.waiting("Missions") };
        let sheet = Sheet::new("Missions");
        if missions.missions.is_empty() {
            return sheet.strong("There are no missions.").line(
                "Copy a mission file into the folder missions of the brick's configuration.",
            );
        }
        sheet.items(missions.missions.iter().map(|mission| {
            let broken = if mission.findings.is_some() { " (broken)" } else { "" };
            format!("{}{broken}", mission.name)
        }))
    }

    fn mission(&self, name: &str) -> Sheet {
        let sheet = Sheet::new("Mission").big(name);
        let Some(info) = self.mission_info(name) else {
            return sheet.line("It is not there any more.");
        };
        if let Some(findings) = &info.findings {
            return sheet.strong("It cannot be started:").line(findings);
        }
        let settings_s = self.seen.settings.as_ref().and_then(|settings| settings.time_limit_s);
        let limit_s = match (info.time_limit_s, settings_s) {
            (Some(own_s), Some(set_s)) => Some(own_s.min(set_s)),
            (own_s, set_s) => own_s.or(set_s),
        };
        let ends = limit_s.map(|s| format!("ends after {} at the latest", duration(s)));
        let stops = match self.options.started_by {
            StartedBy::Brickman => {
                "Enter or Back stops it. Back also closes this menu, and the run with it."
            }
            StartedBy::Boot | StartedBy::Terminal => "Enter or Back stops it.",
        };
        let start = if self.asks.is_starting() { "starting..." } else { "Start" };
        sheet.lines(ends).item(start).line(stops)
    }

    pub(super) fn mission_info(&self, name: &str) -> Option<&MissionInfo> {
        self.seen.missions.as_ref()?.missions.iter().find(|mission| mission.name == name)
    }

    fn runs(&self) -> Sheet {
        let Some(runs) = &self.seen.runs else { return self.waiting("Runs") };
        let sheet = Sheet::new("Runs");
        if runs.runs.is_empty() {
            return sheet.strong("There are no runs yet.");
        }
        sheet.items(runs.runs.iter().map(run_line))
    }

    fn ports(&self) -> Sheet {
        let Some(live) = &self.seen.live else { return self.waiting("Ports") };
        let sheet = Sheet::new("Ports");
        if live.devices.is_empty() {
            return sheet
                .strong("Nothing is plugged in.")
                .line("A sensor needs up to three seconds.");
        }
        sheet.items(
            live.devices.iter().map(|device| {
                format!("{} {}: {}", device.port, short(&device.driver), device.reading)
            }),
        )
    }

    pub(super) fn device(&self, port: &str) -> Option<&LiveDevice> {
        self.seen.live.as_ref()?.devices.iter().find(|device| device.port == port)
    }

    fn port(&self, port: &str) -> Sheet {
        let sheet = Sheet::new("Port").big(port);
        let Some(device) = self.device(port) else {
            return sheet.line("Nothing is plugged in here any more.");
        };
        let role = device.role.as_ref().map_or_else(String::new, |role| format!(", {role}"));
        let holds = device.motor.then_some("Hold Up or Down: it turns, as long as you hold.");
        sheet.line(format!("{}{role}", short(&device.driver))).big(&device.reading).lines(holds)
    }

    fn set_up(&self) -> Sheet {
        let sheet = Sheet::new("Set up");
        if let Some(why) = &self.options.no_talks {
            return sheet.line(why);
        }
        let sheet = sheet.items(super::TalkKind::ALL.map(super::TalkKind::words));
        match self.seen.status.as_ref().and_then(|status| status.robot.as_ref()) {
            Some(finding) => sheet.strong("The robot's file is not in order:").line(finding),
            None => sheet,
        }
    }

    fn settings(&self) -> Sheet {
        let Some(settings) = &self.seen.settings else { return self.waiting("Settings") };
        let sheet = Sheet::new("Settings");
        let on = |is_on: bool| if is_on { "on" } else { "off" };
        let limit = settings.time_limit_s.map_or_else(|| "none".to_owned(), duration);
        let status = self.seen.status.as_ref();
        let link = status.map(|status| format!("link: {}", status.link));
        let clock = status.and_then(|status| status.clock.clone());
        let key = settings.fingerprint.as_ref().map(|key| format!("key: {key}"));
        sheet
            .item(format!("Lights: {}", on(settings.lights)))
            .item(format!("Sounds: {}", on(settings.sounds)))
            .item(format!("Time limit of each run: {limit}"))
            .item("Pair a PC")
            .strong(&settings.brick)
            .lines(&settings.addresses)
            .lines([link, clock, key].into_iter().flatten())
            .line(format!("onbrick {}", settings.version))
    }

    fn running(&self) -> Sheet {
        let Some((status, run)) =
            self.seen.status.as_ref().and_then(|status| Some((status, status.run.as_ref()?)))
        else {
            return Sheet::new("Running").line("...");
        };
        let title = match status.state {
            State::Preparing => "Preparing",
            State::Stopping => "Stopping",
            _ => "Running",
        };
        let sheet = Sheet::new(title).turning();
        let sheet = match &self.notice {
            Some(Notice::Refused { message, .. }) => sheet.strong(message),
            _ => sheet,
        };
        let sheet =
            progress(sheet.strong(&run.mission), run).line(format!("link: {}", status.link));
        let is_stopping = status.state == State::Stopping || self.stop_due_ns.is_some();
        sheet.foot(if is_stopping { "stopping..." } else { "STOP: Enter, Back" })
    }

    fn notice_sheet(&self, notice: &Notice) -> Sheet {
        match notice {
            Notice::Refused { message, hint } => {
                Sheet::new("Not done").strong(message).lines(hint).item("OK")
            }
            Notice::Delete(run) => {
                let name = self.run_info(run).map_or_else(|| run.to_string(), run_line);
                Sheet::new("Delete")
                    .strong("Delete this run and its map?")
                    .line(name)
                    .item("No, keep it")
                    .item("Yes, delete it")
            }
        }
    }
}

/// How a run is going.
pub(super) fn progress(sheet: Sheet, run: &RunStatus) -> Sheet {
    let Some(progress) = &run.progress else {
        return sheet.line(run.waits.as_deref().unwrap_or("getting ready"));
    };
    // What the mission has to say is what people look for first.
    let sheet = progress.said.iter().fold(sheet, |sheet, line| sheet.strong(line));
    let sheet = sheet.line(format!(
        "{} of {}",
        duration(libm::floor(seconds(progress.elapsed_ns))),
        duration(run.time_limit_s)
    ));
    let states = progress.states.iter().map(|(machine, state)| format!("{machine}: {state}"));
    let range = match progress.range {
        Some(Range::Echo(range_m)) => format!("range {range_m:.2} m, "),
        Some(Range::NoEcho) => "no echo, ".to_owned(),
        Some(Range::TooNear) => "too near, ".to_owned(),
        None => String::new(),
    };
    sheet
        .lines(states)
        .line(format!("{range}{:.0}°", within_turn(progress.pose.heading_rad.to_degrees())))
        .line(format!("{:.1} m, {}", progress.travelled_m, counted(progress.points, "point")))
        .lines(&progress.warning)
}

/// −180 to 180 degrees, without a zero that has a sign.
fn within_turn(degrees: f64) -> f64 {
    let within = degrees - 360.0 * libm::round(degrees / 360.0);
    if libm::fabs(within) < 0.5 { 0.0 } else { within }
}

pub(super) fn ended(last: &LastStop, has_map: bool) -> Sheet {
    if last.is_wanted() {
        let sheet = Sheet::new("Done").big(&last.mission).line(last.to_string());
        return sheet.items(has_map.then_some("Show the map")).item("OK");
    }
    let sheet = Sheet::new("Fault");
    let sheet = if last.mission.is_empty() { sheet } else { sheet.big(&last.mission) };
    sheet.strong(last.to_string()).item("Acknowledge")
}

fn time_limit(limit_s: f64) -> Sheet {
    let limit = if limit_s > 0.0 { duration(limit_s) } else { "none".to_owned() };
    Sheet::new("Time limit")
        .line("The limit of each run is")
        .big(limit)
        .line("Up and Down change it, Enter sets it.")
}

fn pairing(pairing: Option<&Pairing>) -> Sheet {
    let sheet = Sheet::new("Pairing");
    match pairing {
        None => sheet.line("asking..."),
        Some(Pairing::Closed) => sheet
            .line("A PC that is introduced may start and stop missions and fetch maps.")
            .item("Open for two minutes"),
        Some(Pairing::Open { seconds }) => sheet
            .big(format!("{seconds} s"))
            .line("On the PC: onbrick pair, and this brick's address.")
            .item("Close"),
        Some(Pairing::Compare { code, name }) => sheet
            // The code first: no name stands above it.
            .big(code)
            .line("Does the PC show this?")
            .line(format!("It says: {name}"))
            .item("No, it is another")
            .item("Yes, the same"),
        Some(Pairing::Paired { name }) => sheet.big("Paired").line(name).item("OK"),
        Some(Pairing::Failed { why }) => sheet.big("Not paired").line(why).item("Open again"),
        Some(Pairing::NoLink { why }) => sheet
            .strong("There is no link now.")
            .line(why)
            .line("Everything else works without it."),
    }
}

/// A run in a list.
fn run_line(run: &RunInfo) -> String {
    let end = match &run.end {
        _ if run.going_on => "running".to_owned(),
        Some(end) => end.stop.reason.word(),
        None => "was cut".to_owned(),
    };
    let points =
        run.points.map_or_else(String::new, |points| format!(", {}", counted(points, "pt")));
    format!("{} {}: {end}{points}", run.number, run.mission)
}

/// A driver's name without what they all begin with.
fn short(driver: &str) -> &str {
    driver.strip_prefix("lego-").unwrap_or(driver)
}

/// Seconds for people: `45 s`, `2 min`, `2 min 5 s`.
fn duration(duration_s: f64) -> String {
    if duration_s < 60.0 {
        let short = format!("{duration_s:.1}");
        return format!("{} s", short.trim_end_matches(".0"));
    }
    let minutes = libm::floor(duration_s / 60.0);
    let rest_s = libm::floor(duration_s - 60.0 * minutes);
    if rest_s > 0.0 { format!("{minutes} min {rest_s} s") } else { format!("{minutes} min") }
}

#[cfg(any(test, feature = "host"))]
impl Menu {
    /// The page on the screen as text, for transcripts and for people who cannot see pictures: what
    /// is chosen has a `>`.
    #[must_use]
    pub fn text(&self) -> String {
        if self.map_on_screen().is_some() {
            return format!("[{}]\n  a map", self.map_title());
        }
        plain(&self.sheet().to_text(self.view()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_and_headings_are_written_for_people() {
        let written = [0.5, 45.0, 60.0, 125.9, 3600.0].map(duration);
        assert_eq!(written, ["0.5 s", "45 s", "1 min", "2 min 5 s", "60 min"]);
        let turned = [0.0, 190.0, -190.0, 720.0, -0.2, -90.0]
            .map(|degrees| format!("{:.0}", within_turn(degrees)));
        assert_eq!(turned, ["0", "-170", "170", "0", "0", "-90"]);
    }
}
