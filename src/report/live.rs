//! A run that is going on, in a browser on this machine: the plot's page, which grows.
//!
//! The page asks for the state each second; the server then reads the recording again, as far as it
//! has come. At `#plot`, beside what every plot page says there, `data-grown` counts how often it
//! has.

use std::path::PathBuf;

use super::{Scene, Track, page};
use crate::page::{LocalPage, PageError, Shown};
use crate::recording::Run;

/// A page that is being served. Dropping it ends that.
#[derive(Debug)]
pub struct LivePage {
    page: LocalPage,
}

impl LivePage {
    /// Serves the page of a recording that is still growing, at a port of 127.0.0.1, 0 for any that
    /// is free. `outlines` says what walls are known of it.
    ///
    /// # Errors
    ///
    /// [`PageError`]; nothing is served then.
    pub fn serve(
        recording: PathBuf,
        title: String,
        port: u16,
        outlines: impl Fn(&Run) -> Vec<Vec<[f64; 2]>> + Send + 'static,
    ) -> Result<Self, PageError> {
        let scene = move || {
            // What has not come yet is nothing to be seen yet.
            let Ok(run) = Run::open(&recording) else {
                return Scene { title: title.clone(), ..Scene::default() };
            };
            let mut track = Track::of_run(&run, &title);
            // A recording that grows has no end, which is no cause for warnings.
            track.warnings.clear();
            Scene {
                title: title.clone(),
                outlines: outlines(&run),
                tracks: vec![track],
                ..Scene::default()
            }
        };
        let page = LocalPage::serve(port, move |path, _| match path {
            "/" => Shown::Html(page::live_html(&scene())),
            "/state" => Shown::Json(page::json(&scene())),
            _ => Shown::Nothing,
        })?;
        Ok(Self { page })
    }

    /// Where the page is.
    #[must_use]
    pub fn url(&self) -> String {
        self.page.url()
    }
}
