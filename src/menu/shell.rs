//! The menu at work: a loop of 20 turns a second over keys and screen, and two threads that ask the
//! service.
//!
//! The loop never waits for the service: a request goes to its lane's thread, and the answer is
//! taken when it is there. It never waits for a key either: the kernel keeps what was pressed until
//! the next turn.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};

use super::{Canvas, Effect, FRAME_NS, Lane, Menu, Replies, Talker, Told, Trouble};
use crate::clock::Clock;
use crate::ev3dev::{ButtonChanges, ButtonSet, Buttons, DeviceError, ScreenError};
use crate::protocol::{Answer, LocalRequest};

/// Where the buttons are looked at.
pub trait Keys {
    /// What happened since the last look, and what is held now; `None` when there will be nothing
    /// more, which closes the menu.
    ///
    /// # Errors
    ///
    /// [`MenuError::Keys`].
    fn look(&mut self) -> Result<Option<(ButtonChanges, ButtonSet)>, MenuError>;
}

/// The brick's own.
impl Keys for Buttons {
    fn look(&mut self) -> Result<Option<(ButtonChanges, ButtonSet)>, MenuError> {
        let changes = self.changes()?;
        Ok(Some((changes, self.held())))
    }
}

/// Where pictures are shown.
pub trait Display {
    /// Shows a picture.
    ///
    /// # Errors
    ///
    /// [`MenuError`].
    fn show(&mut self, menu: &Menu, picture: &Canvas) -> Result<(), MenuError>;

    /// Whether what was shown is lost since the last look, so that it has to be shown again.
    fn has_lost_it(&mut self) -> bool {
        false
    }
}

/// A connection to the service. Each lane's thread has one of its own.
pub trait ServiceConnection: Send {
    /// Asks, waits for the answer, and connects first where that is needed.
    ///
    /// # Errors
    ///
    /// [`Trouble`].
    fn ask(&mut self, request: &LocalRequest) -> Result<Answer, Trouble>;
}

/// Why the menu ended.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MenuError {
    /// The buttons cannot be read.
    #[error("the buttons cannot be read")]
    Keys(#[from] DeviceError),
    /// The screen cannot be drawn on.
    #[error(transparent)]
    Screen(#[from] ScreenError),
    /// Something else of where it is shown.
    #[error("the menu cannot be shown")]
    Shown(#[from] std::io::Error),
}

/// What a menu works with.
pub struct Parts<'p> {
    /// The time.
    pub clock: &'p dyn Clock,
    /// The buttons.
    pub keys: &'p mut dyn Keys,
    /// The screen.
    pub display: &'p mut dyn Display,
    /// A connection for each lane.
    pub connections: [Box<dyn ServiceConnection>; 2],
    /// Sets up and calibrates.
    pub talker: &'p mut dyn Talker,
    /// Raised by a signal: ends the menu.
    pub stop: &'p AtomicBool,
}

crate::printable::debug_by!(Parts<'_>, clock);

/// Shows the menu until a signal or the keys end it.
///
/// # Errors
///
/// [`MenuError`].
pub fn attend(menu: &mut Menu, parts: Parts<'_>) -> Result<(), MenuError> {
    let Parts { clock, keys, display, connections, talker, stop } = parts;
    let mut couriers = connections.map(Courier::start);
    let mut talk = Talking::default();
    let mut next_ns = clock.now_ns();
    while !stop.load(Ordering::Relaxed) {
        menu.tick(clock.now_ns());
        let Some((changes, held)) = keys.look()? else { break };
        press(menu, changes, held);
        for (lane, courier) in Lane::ALL.into_iter().zip(&mut couriers) {
            courier.carry(menu, lane);
        }
        talk.carry(menu, talker);
        if display.has_lost_it() {
            menu.show_again();
        }
        // The picture is taken out first: the display may want to read the page as well.
        if let Some(picture) = menu.picture().cloned() {
            display.show(menu, &picture)?;
        }
        next_ns = (next_ns + FRAME_NS).max(clock.now_ns());
        clock.sleep_until_ns(next_ns);
    }
    talk.end();
    Ok(())
}

/// A button that was both pressed and let go in one turn: what it is now came last.
fn press(menu: &mut Menu, changes: ButtonChanges, held: ButtonSet) {
    for button in changes
        .released
        .iter()
        .filter(|button| held.contains(*button) || !changes.pressed.contains(*button))
    {
        menu.release(button);
    }
    for button in changes.pressed.iter() {
        menu.press(button);
        if !held.contains(button) {
            menu.release(button);
        }
    }
}

/// A thread that carries requests to the service, one after the other. It ends when its sender is
/// gone.
struct Courier {
    requests: Sender<LocalRequest>,
    answers: Receiver<Result<Answer, Trouble>>,
}

impl Courier {
    fn start(mut connection: Box<dyn ServiceConnection>) -> Self {
        let (requests, inbox) = channel::<LocalRequest>();
        let (outbox, answers) = channel();
        std::thread::spawn(move || {
            for request in inbox {
                if outbox.send(connection.ask(&request)).is_err() {
                    return;
                }
            }
        });
        Self { requests, answers }
    }

    fn carry(&mut self, menu: &mut Menu, lane: Lane) {
        for outcome in self.answers.try_iter() {
            menu.learn(lane, outcome);
        }
        if let Some(request) = menu.next_request(lane)
            && self.requests.send(request).is_err()
        {
            menu.learn(lane, Err(Trouble::Gone("the menu's own thread has ended".to_owned())));
        }
    }
}

/// The talk in progress, if any.
#[derive(Default)]
struct Talking {
    open: Option<(Receiver<Told>, Replies)>,
}

impl Talking {
    fn carry(&mut self, menu: &mut Menu, talker: &mut dyn Talker) {
        while let Some(effect) = menu.next_effect() {
            self.effect(effect, talker);
        }
        if let Some((told, _)) = &self.open {
            told.try_iter().for_each(|told| menu.told(told));
        }
    }

    fn effect(&mut self, effect: Effect, talker: &mut dyn Talker) {
        if let Effect::Talk(kind) = effect {
            self.end();
            let (sender, told) = channel();
            self.open = Some((told, talker.begin(kind, sender)));
            return;
        }
        let Some((_, replies)) = &self.open else { return };
        match effect {
            // A listener that is gone has been reported already.
            Effect::Reply(reply) => drop(replies.sender.send(reply)),
            Effect::Pressed => replies.pressed.store(true, Ordering::Relaxed),
            Effect::StopTalk | Effect::Talk(_) => {
                replies.flags.signal.store(true, Ordering::Relaxed)
            }
        }
    }

    /// Nothing is asked any more; what turns stops.
    fn end(&mut self) {
        if let Some((_, replies)) = self.open.take() {
            replies.flags.signal.store(true, Ordering::Relaxed);
        }
    }
}
