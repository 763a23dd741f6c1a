//! What a page shows, as data: rows of text of which some can be chosen, and how they are laid out,
//! scrolled and drawn.
//!
//! A page says what it shows; this file says how it looks. Long texts wrap, and what is longer than
//! the screen scrolls, so no text is cut anywhere; a bar at the right edge says that there is more.
//!
//! ```text
//! ┌──────────────────────────┐
//! │ title              7.9 V │  head, white on black
//! ├──────────────────────────┤
//! │ row                     ▐│
//! │ row that is chosen      ▐│  body, scrolls
//! ├──────────────────────────┤
//! │           STOP           │  foot, where there is one
//! └──────────────────────────┘
//! ```

use embedded_graphics::Drawable;
use embedded_graphics::draw_target::DrawTargetExt;
use embedded_graphics::prelude::{DrawTarget, Point, Primitive, Size};
use embedded_graphics::primitives::{PrimitiveStyle, Rectangle, Triangle};

use super::canvas::{Canvas, HEIGHT, INK, PAPER, WIDTH};
use super::text::{Face, width, wrap, write};

/// Rows of the head, pixels.
pub(super) const HEAD: i32 = 16;

/// Rows of the foot, pixels.
const FOOT: i32 = 20;

/// Where the bar at the right edge begins.
const BAR_X: i32 = 176;

/// How far a press scrolls, pixels: three lines.
const STEP: i32 = 39;

/// The screen's sizes as the drawing counts.
pub(super) const WIDE: i32 = WIDTH.cast_signed();
pub(super) const HIGH: i32 = HEIGHT.cast_signed();

/// One row of a page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Row {
    pub(super) text: String,
    face: Face,
    /// It can be chosen.
    pub(super) is_item: bool,
}

impl Row {
    fn lines(&self) -> Vec<String> {
        wrap(&self.text, usize::try_from(WIDE / self.face.letter()).unwrap_or(1))
    }

    fn height(&self) -> i32 {
        let lines = i32::try_from(self.lines().len()).unwrap_or(i32::MAX);
        // A pixel above and below what can be chosen, so that the black bar has an edge.
        lines.saturating_mul(self.face.line()) + if self.is_item { 2 } else { 0 }
    }
}

/// What a page shows.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Sheet {
    /// At most 14 letters, so that it stands beside what else is in the head.
    pub(super) title: &'static str,
    /// Left and Right turn to other pages.
    pub(super) turns: bool,
    /// From top to bottom.
    pub(super) rows: Vec<Row>,
    /// What the big button does, where there is one.
    pub(super) foot: Option<&'static str>,
}

/// Where a person is on a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct View {
    /// Which of the things that can be chosen, counted from 0.
    pub(super) chosen: usize,
    /// How far it is scrolled, pixels.
    offset: i32,
}

impl View {
    /// At the top, with this chosen.
    pub(super) fn at(chosen: usize) -> Self {
        Self { chosen, ..Self::default() }
    }
}

impl Sheet {
    pub(super) fn new(title: &'static str) -> Self {
        Self { title, ..Self::default() }
    }

    fn row(mut self, face: Face, is_item: bool, text: impl Into<String>) -> Self {
        self.rows.push(Row { text: text.into(), face, is_item });
        self
    }

    pub(super) fn line(self, text: impl Into<String>) -> Self {
        self.row(Face::Plain, false, text)
    }

    pub(super) fn lines(self, texts: impl IntoIterator<Item: Into<String>>) -> Self {
        texts.into_iter().fold(self, Self::line)
    }

    pub(super) fn strong(self, text: impl Into<String>) -> Self {
        self.row(Face::Strong, false, text)
    }

    pub(super) fn big(self, text: impl Into<String>) -> Self {
        self.row(Face::Big, false, text)
    }

    pub(super) fn item(self, text: impl Into<String>) -> Self {
        self.row(Face::Plain, true, text)
    }

    pub(super) fn items(self, texts: impl IntoIterator<Item: Into<String>>) -> Self {
        texts.into_iter().fold(self, Self::item)
    }

    pub(super) fn foot(mut self, text: &'static str) -> Self {
        self.foot = Some(text);
        self
    }

    pub(super) fn turning(mut self) -> Self {
        self.turns = true;
        self
    }

    /// How many rows can be chosen.
    pub(super) fn choices(&self) -> usize {
        self.rows.iter().filter(|row| row.is_item).count()
    }

    fn room(&self) -> i32 {
        HIGH - HEAD - if self.foot.is_some() { FOOT } else { 0 }
    }

    fn total(&self) -> i32 {
        self.rows.iter().map(Row::height).fold(0, i32::saturating_add)
    }

    fn furthest(&self) -> i32 {
        (self.total() - self.room()).max(0)
    }

    /// Top and bottom of a row that can be chosen.
    fn span(&self, item: usize) -> Option<(i32, i32)> {
        let mut top = 0;
        let mut count = 0;
        for row in &self.rows {
            let bottom = top + row.height();
            if row.is_item {
                if count == item {
                    return Some((top, bottom));
                }
                count += 1;
            }
            top = bottom;
        }
        None
    }

    fn is_seen(&self, item: usize, offset: i32) -> bool {
        self.span(item).is_some_and(|(top, bottom)| {
            // What is higher than the page is seen when its first lines are.
            top >= offset && bottom.min(top + STEP) <= offset + self.room()
        })
    }

    /// The view as far as this page has it: a list may have become shorter.
    pub(super) fn fit(&self, view: View) -> View {
        View {
            chosen: view.chosen.min(self.choices().saturating_sub(1)),
            offset: view.offset.clamp(0, self.furthest()),
        }
    }

    /// One step down: to the next thing, or a few lines on where it is not in view yet.
    pub(super) fn down(&self, view: View) -> View {
        let view = self.fit(view);
        let next =
            if self.is_seen(view.chosen, view.offset) { view.chosen + 1 } else { view.chosen };
        if self.is_seen(next, view.offset) {
            return View { chosen: next, ..view };
        }
        let offset = (view.offset + STEP).min(self.furthest());
        let chosen = if self.is_seen(next, offset) { next } else { view.chosen };
        View { chosen, offset }
    }

    /// One step up.
    pub(super) fn up(&self, view: View) -> View {
        let view = self.fit(view);
        let before = if self.is_seen(view.chosen, view.offset) {
            view.chosen.checked_sub(1)
        } else {
            Some(view.chosen)
        };
        let offset = (view.offset - STEP).max(0);
        match before {
            Some(before) if self.is_seen(before, view.offset) => View { chosen: before, ..view },
            Some(before) if self.is_seen(before, offset) => View { chosen: before, offset },
            _ => View { offset, ..view },
        }
    }

    /// Whether what is chosen can be seen: nothing is taken that is not.
    pub(super) fn sees_chosen(&self, view: View) -> bool {
        let view = self.fit(view);
        self.is_seen(view.chosen, view.offset)
    }

    /// Draws the page; `corner` stands at the head's right.
    pub(super) fn draw(&self, canvas: &mut Canvas, view: View, corner: &str) {
        let Ok(()) = canvas.clear(PAPER);
        self.body(canvas, self.fit(view));
        if let Some(foot) = self.foot {
            draw_foot(canvas, foot);
        }
        head(canvas, self.title, corner, self.turns);
    }

    fn body(&self, canvas: &mut Canvas, view: View) {
        let area = Rectangle::new(Point::new(0, HEAD), size(WIDE, self.room()));
        let mut top = HEAD - view.offset;
        let mut item = 0;
        for row in &self.rows {
            let height = row.height();
            let is_chosen = row.is_item && item == view.chosen;
            item += usize::from(row.is_item);
            if top + height > HEAD && top < HEAD + self.room() {
                let (paper, ink) = if is_chosen { (INK, PAPER) } else { (PAPER, INK) };
                if is_chosen {
                    let bar = Rectangle::new(Point::new(0, top), size(BAR_X, height));
                    let Ok(()) = canvas.clipped(&area).fill_solid(&bar, paper);
                }
                let mut at = top + i32::from(row.is_item);
                for line in row.lines() {
                    // A line that is only half in view would be half a line: it comes with the next
                    // step.
                    if at >= HEAD && at + row.face.line() <= HEAD + self.room() + 2 {
                        write(canvas, &line, Point::new(1, at), row.face, ink);
                    }
                    at += row.face.line();
                }
            }
            top += height;
        }
        self.bar(canvas, view.offset);
    }

    /// How far down one is, at the right edge.
    fn bar(&self, canvas: &mut Canvas, offset: i32) {
        let (total, room) = (self.total(), self.room());
        if total <= room {
            return;
        }
        let height = (room * room / total).max(6);
        let top = HEAD + (room - height) * offset / self.furthest().max(1);
        let bar = Rectangle::new(Point::new(BAR_X, top), size(WIDE - BAR_X, height));
        let Ok(()) = canvas.fill_solid(&bar, INK);
    }

    /// The page as text: for transcripts. What is chosen has a `>`.
    #[cfg(any(test, feature = "host"))]
    pub(super) fn to_text(&self, view: View) -> String {
        let view = self.fit(view);
        let mut text = format!("[{}]", self.title);
        let mut item = 0;
        for row in &self.rows {
            let mark = if row.is_item && item == view.chosen { "> " } else { "  " };
            item += usize::from(row.is_item);
            text.push_str(&format!("\n{mark}{}", row.text));
        }
        if let Some(foot) = self.foot {
            text.push_str(&format!("\n({foot})"));
        }
        text
    }
}

/// Sizes are differences of coordinates and never below nothing.
pub(super) fn size(width: i32, height: i32) -> Size {
    Size::new(u32::try_from(width).unwrap_or(0), u32::try_from(height).unwrap_or(0))
}

/// The head of a page.
pub(super) fn head(canvas: &mut Canvas, title: &str, corner: &str, turns: bool) {
    let Ok(()) = canvas.fill_solid(&Rectangle::new(Point::zero(), size(WIDE, HEAD - 1)), INK);
    let mut left = 2;
    if turns {
        arrow(canvas, left, -1);
        left += 9;
    }
    write(canvas, title, Point::new(left, 1), Face::Strong, PAPER);
    if turns {
        arrow(canvas, left + width(title, Face::Strong) + 3, 1);
    }
    write(canvas, corner, Point::new(WIDE - 1 - width(corner, Face::Plain), 1), Face::Plain, PAPER);
}

/// A small triangle in the head; it points to the left or to the right.
fn arrow(canvas: &mut Canvas, left: i32, way: i32) {
    let (tip, back) = if way < 0 { (left, left + 5) } else { (left + 5, left) };
    let triangle = Triangle::new(Point::new(tip, 7), Point::new(back, 2), Point::new(back, 12));
    let Ok(()) = triangle.into_styled(PrimitiveStyle::with_fill(PAPER)).draw(canvas);
}

/// The big button at the bottom.
fn draw_foot(canvas: &mut Canvas, text: &str) {
    let Ok(()) =
        canvas.fill_solid(&Rectangle::new(Point::new(0, HIGH - FOOT), size(WIDE, FOOT)), INK);
    let left = (WIDE - width(text, Face::Big)) / 2;
    write(canvas, text, Point::new(left, HIGH - FOOT + 1), Face::Big, PAPER);
}
