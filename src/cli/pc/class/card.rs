//! A brick's card, as the page is sent it.

use serde_json::{Value, json};

use super::brick::{Brick, Said, Seen, Stopping};
use crate::cli::pc::status::{battery, going};
use crate::clock::seconds;
use crate::protocol::{State, Status};
use crate::threads::lock;

/// What one brick's card shows. The page orders cards by `wrong`: 2 is wrong, 1 worth a look, 0 in
/// order.
pub(super) fn card(brick: &Brick, now_ns: i64) -> Value {
    let seen = lock(&brick.seen);
    let since_s = |ns: i64| seconds(now_ns.saturating_sub(ns).max(0));
    let status = seen.status.as_ref();
    let silent_s = seen.silent_ns.map(since_s);
    let (wrong, why) = wrong(&seen);
    let state = if silent_s.is_some() { None } else { status.map(|status| status.state) };
    let run = status.and_then(|status| status.run.as_ref());
    let progress = run.and_then(|run| run.progress.as_ref());
    json!({
        "name": brick.known.name,
        "address": brick.known.address,
        "fingerprint": brick.known.key.fingerprint(),
        "state": state,
        "words": words(&seen),
        "state_s": status.map(|status| status.state_s),
        "silent_s": silent_s,
        "wrong": wrong,
        "why": why,
        "battery": status.map(battery),
        "version": status.map(|status| &status.version),
        "mission": run.map(|run| &run.mission),
        "limit_s": run.map(|run| run.time_limit_s),
        "elapsed_s": progress.map(|progress| seconds(progress.elapsed_ns)),
        "detail": run.map(going),
        "pose": progress.map(|at| [at.pose.x_m, at.pose.y_m, at.pose.heading_rad]),
        "points": progress.map(|progress| progress.points),
        "stop": seen.stopping.as_ref().map(|stopping| stop(stopping, &since_s)),
        "said": seen.said.as_ref().map(|Said { text, is_good }| json!([text, is_good])),
    })
}

/// How far a stop is.
fn stop(stopping: &Stopping, since_s: &impl Fn(i64) -> f64) -> Value {
    let Stopping { asked_ns, told_ns, still_ns, failed } = stopping;
    let after_s = |ns: &i64| seconds(ns.saturating_sub(*asked_ns));
    json!({
        "asked_s": since_s(*asked_ns),
        "told_after_s": told_ns.as_ref().map(after_s),
        "still_after_s": still_ns.as_ref().map(after_s),
        "failed": failed,
    })
}

/// A state for people.
fn words(seen: &Seen) -> String {
    let words = match (seen.silent_ns, &seen.status) {
        (Some(_), None) => "not heard yet",
        (Some(_), Some(_)) => "no answer",
        (None, Some(status)) if status.state == State::Running => "driving",
        (None, Some(status)) => return status.state.to_string(),
        (None, None) => "asking",
    };
    words.to_owned()
}

/// How bad it is, and what of it.
fn wrong(seen: &Seen) -> (u8, Vec<String>) {
    let found: Vec<(u8, String)> = match (&seen.trouble, &seen.status) {
        (Some(trouble), _) => vec![(2, trouble.clone())],
        (None, Some(status)) => wrong_there(status),
        (None, None) => Vec::new(),
    };
    let worst = found.iter().map(|(level, _)| *level).max().unwrap_or(0);
    let plain = |text: &str| text.trim_end().trim_start_matches("error: ").to_owned();
    (worst, found.iter().map(|(_, text)| plain(text)).collect())
}

/// What a brick says of itself, each with how bad it is.
fn wrong_there(status: &Status) -> Vec<(u8, String)> {
    let last = || status.last.as_ref().map_or_else(|| "a fault".to_owned(), ToString::to_string);
    let (version, own) = (&status.version, env!("CARGO_PKG_VERSION"));
    let other = || format!("it has onbrick {version}, and this PC {own}");
    let texts = [
        (2, (status.state == State::Fault).then(last)),
        (2, status.robot.clone()),
        (2, status.battery.clone()),
        (1, status.taken.clone()),
        (1, (version != own).then(other)),
        (1, status.clock.clone()),
        (1, Some(status.link.clone()).filter(|link| link != "ready")),
    ];
    texts.into_iter().filter_map(|(level, text)| Some((level, text?))).collect()
}
