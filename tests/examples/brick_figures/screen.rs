//! What stands on a screen, read back from its memory: `screen FRAMEBUFFER COPY [PICTURE]`.
//!
//! Letters are known by their pixels, in the menu's three fonts: what is printed is what a person
//! in front of the screen reads, whatever the menu believes that it has drawn. `COPY` gets the
//! picture as PGM. With the name of one of the golden pictures, every pixel must be as there but
//! for the battery's voltage at the head's right.
//!
//! # What we count on
//!
//! - The menu's lines begin at the left edge; the head's and the foot's anywhere
//!   (`src/menu/sheet.rs`).

use std::collections::BTreeMap;
use std::error::Error;
use std::fs::File;
use std::io::Read;

use embedded_graphics::Drawable;
use embedded_graphics::mono_font::iso_8859_15::{FONT_7X13, FONT_7X13_BOLD, FONT_9X18_BOLD};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::{Gray2, GrayColor};
use embedded_graphics::prelude::Point;
use embedded_graphics::text::{Baseline, Text};
use onbrick::menu::{Canvas, HEIGHT, WIDTH};

/// Where the head's right corner begins, and where the head ends.
const CORNER: (usize, usize) = (110, 16);

const WIDE: usize = WIDTH as usize;
const HIGH: usize = HEIGHT as usize;

pub(crate) fn screen(
    framebuffer: &str,
    copy: &str,
    golden: Option<&str>,
) -> Result<(), Box<dyn Error>> {
    let picture = Picture::read(framebuffer)?;
    std::fs::write(
        copy,
        [format!("P5\n{WIDTH} {HEIGHT}\n255\n").as_bytes(), &picture.pixels].concat(),
    )?;
    println!("{}", picture.text());
    let Some(name) = golden else { return Ok(()) };
    let kept: &[u8] = match name {
        "missions" => include_bytes!("../../data/menu/missions.png"),
        "mission" => include_bytes!("../../data/menu/mission.png"),
        "runs-none" => include_bytes!("../../data/menu/runs-none.png"),
        "time-limit" => include_bytes!("../../data/menu/time-limit.png"),
        _ => return Err(format!("there is no picture {name} in this program").into()),
    };
    let mut reader = png::Decoder::new(kept).read_info()?;
    let mut pixels = vec![0; reader.output_buffer_size()];
    reader.next_frame(&mut pixels)?;
    let differ = (0..HIGH * WIDE)
        .filter(|at| at % WIDE < CORNER.0 || at / WIDE >= CORNER.1)
        .filter(|at| pixels.get(*at) != picture.pixels.get(*at))
        .count();
    if differ == 0 {
        Ok(())
    } else {
        Err(format!("{differ} pixels are not as in {name}.png").into())
    }
}

/// A grey for each pixel, row by row.
struct Picture {
    pixels: Vec<u8>,
}

impl Picture {
    fn read(framebuffer: &str) -> Result<Self, Box<dyn Error>> {
        let stride: usize =
            std::fs::read_to_string("/sys/class/graphics/fb0/stride")?.trim().parse()?;
        let mut bytes = vec![0; stride * HIGH];
        File::open(framebuffer)?.read_exact(&mut bytes)?;
        let rows =
            bytes.chunks_exact(stride).flat_map(|row| row.as_chunks::<4>().0.iter().take(WIDE));
        let greys: Option<Vec<u8>> = rows
            .map(|[red, green, blue, _]| (red == green && green == blue).then_some(*red))
            .collect();
        Ok(Self { pixels: greys.ok_or("there is a pixel of another colour than grey")? })
    }

    fn text(&self) -> String {
        let faces = [&FONT_7X13, &FONT_7X13_BOLD, &FONT_9X18_BOLD].map(Face::of);
        let [_, _, big] = &faces;
        let mut lines = vec![format!("[{}]", scanned(&faces[..2], self, 1).trim_end())];
        let mut y = CORNER.1;
        while y < HIGH {
            match faces.iter().find_map(|face| Some((face.line(self, y)?, face.height))) {
                Some((line, height)) => {
                    // What is chosen is white on a black bar from edge to edge.
                    let is_chosen = self.pixels.get(y * WIDE).is_some_and(|grey| *grey < 128);
                    lines.push(format!(
                        "{}{}",
                        if is_chosen { "> " } else { "  " },
                        line.trim_end()
                    ));
                    y += height;
                }
                None => y += 1,
            }
        }
        let foot = scanned(std::slice::from_ref(big), self, HIGH - 19);
        if foot.trim().len() > 3 {
            lines.push(format!("({})", foot.trim()));
        }
        lines.join("\n")
    }

    /// The rows of bits of a rectangle, black as 1; none where it is not all in the picture.
    fn bits(&self, (x, y): (usize, usize), (width, height): (usize, usize)) -> Option<Vec<u16>> {
        if x + width > WIDE {
            return None;
        }
        (y..y + height)
            .map(|row| {
                let row = self.pixels.get(row * WIDE + x..row * WIDE + x + width)?;
                Some(row.iter().fold(0, |bits, grey| bits << 1 | u16::from(*grey < 128)))
            })
            .collect()
    }
}

/// A font's letters by their pixels.
struct Face {
    width: usize,
    height: usize,
    letters: BTreeMap<Vec<u16>, char>,
}

impl Face {
    fn of(font: &MonoFont<'_>) -> Self {
        let (width, height) =
            (font.character_size.width as usize, font.character_size.height as usize);
        let mut face = Self { width, height, letters: BTreeMap::new() };
        for letter in (' '..='~').chain('¡'..='ÿ').chain(['€']).rev() {
            let mut canvas = Canvas::default();
            let style = MonoTextStyle::new(font, Gray2::BLACK);
            let text = letter.to_string();
            let Ok(_) =
                Text::with_baseline(&text, Point::zero(), style, Baseline::Top).draw(&mut canvas);
            let drawn = Picture { pixels: canvas.pixels().to_vec() };
            if let Some(bits) = drawn.bits((0, 0), (width, height)) {
                face.letters.insert(bits, letter);
            }
        }
        face
    }

    /// The letter that stands here, in black on white or in white on black.
    fn letter(&self, picture: &Picture, at: (usize, usize)) -> Option<char> {
        let bits = picture.bits(at, (self.width, self.height))?;
        let all = (1 << self.width) - 1;
        let turned = || bits.iter().map(|row| !row & all).collect::<Vec<_>>();
        self.letters.get(&bits).or_else(|| self.letters.get(&turned())).copied()
    }

    /// The line that begins here: letters from edge to edge.
    fn line(&self, picture: &Picture, y: usize) -> Option<String> {
        let columns = (WIDE - 3) / self.width;
        let line: Option<String> =
            (0..columns).map(|column| self.letter(picture, (1 + column * self.width, y))).collect();
        line.filter(|line| !line.trim().is_empty())
    }
}

/// Words wherever they begin in these rows.
fn scanned(faces: &[Face], picture: &Picture, y: usize) -> String {
    let mut text = String::new();
    let mut x = 0;
    while x < WIDE {
        let seen = |face: &Face| {
            Some((face.letter(picture, (x, y)).filter(|letter| *letter != ' ')?, face.width))
        };
        match faces.iter().find_map(seen) {
            Some((letter, width)) => {
                text.push(letter);
                x += width;
            }
            None => {
                let blank = faces.first().map(|face| (face.letter(picture, (x, y)), face.width));
                let is_blank = matches!(blank, Some((Some(' '), _)));
                if is_blank && !text.ends_with(' ') && !text.is_empty() {
                    text.push(' ');
                    x += blank.map_or(1, |(_, width)| width);
                } else {
                    x += 1;
                }
            }
        }
    }
    text
}
