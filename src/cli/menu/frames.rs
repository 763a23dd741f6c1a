//! The menu's pictures as PNG files, one for each that is new: for tests, and for people far from a
//! screen.

use std::io;
use std::path::{Path, PathBuf};

use crate::menu::{Canvas, Display, HEIGHT, Menu, MenuError, WIDTH};
use crate::report::png_file;

/// A folder of pictures: `0001.png` on, and `page.txt`, the page on the screen as text.
#[derive(Debug)]
pub(super) struct Frames {
    folder: PathBuf,
    count: u32,
}

impl Frames {
    /// Makes the folder.
    pub(super) fn into(folder: &Path) -> io::Result<Self> {
        std::fs::create_dir_all(folder)?;
        Ok(Self { folder: folder.to_owned(), count: 0 })
    }
}

impl Display for Frames {
    fn show(&mut self, menu: &Menu, picture: &Canvas) -> Result<(), MenuError> {
        self.count += 1;
        let path = self.folder.join(format!("{:04}.png", self.count));
        let greys = png::ColorType::Grayscale;
        let png = png_file([WIDTH, HEIGHT], greys, picture.pixels()).map_err(io::Error::from)?;
        std::fs::write(&path, png)?;
        // Written in one piece: another process may be reading it.
        let page = self.folder.join("page.txt");
        let fresh = self.folder.join("page.new");
        std::fs::write(&fresh, menu.text())?;
        Ok(std::fs::rename(fresh, page)?)
    }
}
