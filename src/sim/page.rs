//! The live page: a simulation in a browser on this machine.
//!
//! The page is `page.html` with the room inside; it asks for [`View`](super::View)s as JSON at
//! `/state?since=N` seven times a second. Each question lets the time pass that has gone by on the
//! simulation's clock, so that a simulation in real time continues even if no program reads a file.
//!
//! The page draws on a canvas and says at it what it draws: `data-time`, `data-x`, `data-y`,
//! `data-heading` of the first robot, `data-moved` since the page was opened, `data-walls`,
//! `data-robots`, `data-echoes`, `data-faults`.
//!
//! What a person does to the robots there is posted to `/order` as the text of orders
//! ([`Order`](super::Order)): the brick's buttons.
//!
//! # Not here
//!
//! The page loads nothing from elsewhere; its own policy forbids it. Who may look and post is the
//! server's matter (`page`).

use super::Simulation;
pub use crate::page::PageError;
use crate::page::{LocalPage, Shown, inside_script};

const TEMPLATE: &str = include_str!("page.html");

/// A page that is being served. Dropping it ends that.
#[derive(Debug)]
pub struct Page {
    page: LocalPage,
}

impl Page {
    /// Serves a simulation's page at a port of 127.0.0.1, 0 for any that is free, and begins to
    /// watch it.
    ///
    /// # Errors
    ///
    /// [`PageError`]; nothing is served then.
    pub fn serve(simulation: &Simulation, port: u16) -> Result<Self, PageError> {
        let room = simulation.room().ok_or(PageError::Nothing("this simulation has no world"))?;
        let room = serde_json::to_string(&room)
            .map_err(|_| PageError::Nothing("this world's room is not to be written as JSON"))?;
        let html = TEMPLATE.replace("\"@ROOM@\"", &inside_script(&room));
        let (shown, changed) = (simulation.clone(), simulation.clone());
        let show = move |path: &str, query: &str| match path {
            "/" => Shown::Html(html.clone()),
            "/state" => state(query, &shown),
            _ => Shown::Nothing,
        };
        let take = move |path: &str, text: &str| match path {
            "/order" => changed
                .control(0, text)
                .map_or_else(|why| Shown::Refused(why.to_string()), |()| Shown::Done),
            _ => Shown::Fixed,
        };
        let page = LocalPage::serve_and_take(port, show, take)?;
        simulation.watch();
        Ok(Self { page })
    }

    /// Where the page is.
    #[must_use]
    pub fn url(&self) -> String {
        self.page.url()
    }
}

fn state(query: &str, simulation: &Simulation) -> Shown {
    let since = query.strip_prefix("since=").and_then(|number| number.parse().ok()).unwrap_or(0);
    let view = simulation.view(since).and_then(|view| serde_json::to_string(&view).ok());
    view.map_or(Shown::Failed, Shown::Json)
}
