//! The pages for people: README.md, those of the folders, and those of the crate documentation.
#![cfg(feature = "host")]

use std::path::{Path, PathBuf};

const PAGES: [&str; 5] =
    ["README.md", "brick-image/README.md", "tests/README.md", "src/USING.md", "src/CHANGELOG.md"];

fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn text(page: &Path) -> String {
    std::fs::read_to_string(page).unwrap_or_else(|error| panic!("{}: {error}", page.display()))
}

/// Where a page's links and pictures lead: what stands between `](` and `)`, but for the web.
fn links(text: &str) -> impl Iterator<Item = &str> {
    let ends = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    ends.filter(|link| !link.contains("://") && !link.contains("::"))
}

/// A heading as GitHub names its place.
fn anchor(heading: &str) -> String {
    let kept = heading.chars().filter(|c| c.is_alphanumeric() || [' ', '-', '_'].contains(c));
    kept.collect::<String>().to_lowercase().replace(' ', "-")
}

#[test]
fn the_readme_is_a_page_of_at_most_200_lines() {
    let lines = text(&repository().join("README.md")).lines().count();
    assert!(lines <= 200, "{lines}");
}

#[test]
fn every_link_leads_to_what_is_there() {
    let mut found = 0;
    for page in PAGES {
        let path = repository().join(page);
        let own = text(&path);
        for link in links(&own) {
            let (file, place) = link.split_once('#').unwrap_or((link, ""));
            let to: PathBuf =
                if file.is_empty() { path.clone() } else { path.parent().unwrap().join(file) };
            assert!(to.exists(), "{page}: {link}");
            let headings: Vec<String> = match place {
                "" => vec![String::new()],
                _ => text(&to)
                    .lines()
                    .filter(|line| line.starts_with('#'))
                    .map(|line| anchor(line.trim_start_matches('#').trim_start()))
                    .collect(),
            };
            assert!(headings.iter().any(|heading| heading == place), "{page}: {link}");
            found += 1;
        }
    }
    assert!(found > 25, "{found} links");
}

#[test]
fn pictures_are_small() {
    for entry in std::fs::read_dir(repository().join("tests/pictures")).unwrap() {
        let entry = entry.unwrap();
        let bytes = entry.metadata().unwrap().len();
        assert!(bytes < 100_000, "{}: {bytes} bytes", entry.path().display());
    }
}

#[test]
fn every_mission_on_a_page_is_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let mut checked = 0;
    for page in PAGES {
        let text = text(&repository().join(page));
        for block in text.split("```toml\n").skip(1) {
            let block = block.split("```").next().unwrap();
            if block.contains("[machine.") {
                std::fs::write(folder.path().join("page.toml"), block).unwrap();
                crate::commands::run(folder.path(), &["check", "page.toml"]).expect(0);
                checked += 1;
            }
        }
    }
    assert!(checked >= 2, "{checked} missions");
}
