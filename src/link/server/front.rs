//! The thread between the sockets and the workers: it refuses requests without a name, and answers
//! at once what it can.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use nix::sys::resource::{Resource, getrlimit, setrlimit};

use super::limits::MOST_OPEN;
use super::router::{Arrived, Router};
use super::workers::{Job, Workers, framed};
use super::{LinkState, NAP_MS, ServerConfig, ServerError, Shared, zap};
use crate::link::keys::{Authorised, KeyPair, PublicKey};
use crate::link::{if_ready, pairing};
use crate::protocol::{Answer, Kind, NotUnderstood, Operations, Refusal, Request, parse};
use crate::service::config::LinkConfig;
use crate::threads::Background;

/// Requests that may wait for their answer: of one connection, and of all.
const MOST_WAITING_OF_ONE: usize = 16;
const MOST_WAITING: usize = 128;

/// Requests that are taken in one turn, before replies are looked at again.
const TAKEN_IN_ONE_TURN: usize = 32;

/// Descriptors that the rest of the service needs beside the connections'.
const OTHER_DESCRIPTORS: nix::libc::rlim_t = 464;

/// What the front holds. Fields are dropped in this order: the sockets close before the handler
/// that guards them goes.
pub(super) struct Front<'s> {
    router: Router,
    pairing: Option<Router>,
    workers: Workers,
    handler: Background,
    authorised: Authorised,
    waiting: BTreeMap<Vec<u8>, usize>,
    context: zmq::Context,
    config: &'s ServerConfig,
    shared: &'s Shared,
}

impl<'s> Front<'s> {
    /// Binds the handler, then the socket.
    pub(super) fn open(
        shared: &'s Shared,
        config: &'s ServerConfig,
        own: KeyPair,
        context: &zmq::Context,
        operations: Arc<dyn Operations>,
    ) -> Result<Self, ServerError> {
        make_room_for_descriptors();
        let authorised = Authorised::below(&config.keys);
        let handler = zap::handler(context, authorised.clone(), Arc::clone(&shared.window))?;
        let workers = Workers::start(context, &operations)?;
        let endpoint = endpoint(&config.listens.address, config.listens.port);
        let router = Router::open(context, &own, zap::REQUESTS, &endpoint)?;
        shared.port.store(router.port, Ordering::Relaxed);
        log::info!("the link listens at {endpoint} with the key {}", own.public().fingerprint());
        shared.set(LinkState::Ready { fingerprint: own.public().fingerprint() });
        Ok(Self {
            router,
            pairing: None,
            workers,
            handler,
            authorised,
            waiting: BTreeMap::new(),
            context: context.clone(),
            config,
            shared,
        })
    }

    /// Serves until it is told to end.
    ///
    /// # Errors
    ///
    /// [`ServerError::NoHandler`], [`ServerError::NoWorker`], [`ServerError::Socket`]: the sockets
    /// close.
    pub(super) fn run(&mut self) -> Result<(), ServerError> {
        while !self.shared.is_stopped() {
            if self.handler.is_gone() {
                return Err(ServerError::NoHandler);
            }
            self.open_or_close_pairing();
            self.wait()?;
            self.router.look_after();
            while let Some(frames) = self.workers.done()? {
                self.forget(&frames);
                self.router.reply(frames);
            }
            for _ in 0..TAKEN_IN_ONE_TURN {
                let Some(arrived) = self.router.receive()? else {
                    break;
                };
                self.take(arrived)?;
            }
            self.serve_pairing()?;
        }
        Ok(())
    }

    fn wait(&self) -> Result<(), ServerError> {
        let mut items = Vec::from(self.router.poll_items());
        items.push(self.workers.poll_item());
        if let Some(pairing) = &self.pairing {
            items.extend(pairing.poll_items());
        }
        if_ready(zmq::poll(&mut items, i64::from(NAP_MS)))?;
        Ok(())
    }

    /// Hands a request to a worker, or refuses it.
    fn take(&mut self, arrived: Arrived) -> Result<(), ServerError> {
        let Arrived { envelope, key, payload } = arrived;
        match self.understood(&envelope, key, payload) {
            Ok((name, asked)) => {
                *self.waiting.entry(whose(&envelope)).or_insert(0) += 1;
                self.workers.take(Job { envelope, asked, name })
            }
            Err(NotUnderstood { id, refusal }) => {
                log::debug!("the link refuses: {refusal}");
                self.router.reply(framed(envelope, id, Err(refusal)));
                Ok(())
            }
        }
    }

    fn understood(
        &self,
        envelope: &[Vec<u8>],
        key: Option<PublicKey>,
        payload: Option<zmq::Message>,
    ) -> Result<(String, crate::protocol::Asked<Request>), NotUnderstood> {
        let payload =
            payload.ok_or_else(|| Refusal::bad_request("a request is one frame of JSON"))?;
        let asked = parse(&payload);
        // A peer that may not ask learns only that, under the name of the request.
        let id = || match &asked {
            Ok(asked) => Some(asked.id.clone()),
            Err(error) => error.id.clone(),
        };
        let name = self.name_of(key).map_err(|refusal| NotUnderstood { id: id(), refusal })?;
        let of_one = self.waiting.get(&whose(envelope)).copied().unwrap_or(0);
        if of_one >= MOST_WAITING_OF_ONE || self.waiting.values().sum::<usize>() >= MOST_WAITING {
            let refusal = Refusal::new(Kind::TooMany, "too many requests wait for their answers");
            return Err(NotUnderstood {
                id: id(),
                refusal: refusal.hint("wait for a reply before you ask more"),
            });
        }
        Ok((name, asked?))
    }

    /// The name of a key, looked up for each request: a key that was just revoked has none.
    fn name_of(&self, key: Option<PublicKey>) -> Result<String, Refusal> {
        let unknown =
            || Refusal::new(Kind::NotAuthorised, "this key is not, or no longer, authorised here");
        let key = key.ok_or_else(unknown)?;
        let found = self.authorised.find(&key).map_err(|error| {
            log::warn!("a key is not let in: {error}");
            unknown()
        })?;
        found.ok_or_else(|| unknown().hint("onbrick pair, with a person at the brick"))
    }

    fn forget(&mut self, frames: &[Vec<u8>]) {
        let whose = whose(frames);
        if let Some(count) = self.waiting.get_mut(&whose) {
            *count = count.saturating_sub(1);
            if *count == 0 {
                self.waiting.remove(&whose);
            }
        }
    }

    fn open_or_close_pairing(&mut self) {
        let window = &self.shared.window;
        if !window.is_open() {
            self.pairing = None;
        } else if self.pairing.is_none() {
            let LinkConfig { address, pairing_port, .. } = &self.config.listens;
            let endpoint = endpoint(address, *pairing_port);
            match Router::open(&self.context, &pairing::well_known(), zap::PAIRING, &endpoint) {
                Ok(router) => {
                    self.shared.pairing_port.store(router.port, Ordering::Relaxed);
                    self.pairing = Some(router);
                }
                Err(error) => window.close(&error.to_string()),
            }
        }
    }

    fn serve_pairing(&mut self) -> Result<(), ServerError> {
        let Some(router) = &mut self.pairing else { return Ok(()) };
        router.look_after();
        for _ in 0..TAKEN_IN_ONE_TURN {
            let Some(arrived) = router.receive()? else { break };
            let bytes: &[u8] = arrived.payload.as_ref().map_or(&[], |payload| payload);
            let (id, answered) = match self.shared.window.answer_request(arrived.key, bytes) {
                Ok((id, value)) => (Some(id), Ok(Answer { value, bytes: None })),
                Err(NotUnderstood { id, refusal }) => (id, Err(refusal)),
            };
            router.reply(framed(arrived.envelope, id, answered));
        }
        Ok(())
    }
}

fn whose(envelope: &[Vec<u8>]) -> Vec<u8> {
    envelope.first().cloned().unwrap_or_default()
}

fn endpoint(address: &str, port: u16) -> String {
    let port = if port == 0 { "*".to_owned() } else { port.to_string() };
    let address = if address.contains(':') { format!("[{address}]") } else { address.to_owned() };
    format!("tcp://{address}:{port}")
}

/// libzmq's thread spins where descriptors run out, so there are more than connections can take.
fn make_room_for_descriptors() {
    let wanted = nix::libc::rlim_t::try_from(MOST_OPEN).unwrap_or(0) + OTHER_DESCRIPTORS;
    let Ok((soft, hard)) = getrlimit(Resource::RLIMIT_NOFILE) else { return };
    if soft < wanted && setrlimit(Resource::RLIMIT_NOFILE, wanted.min(hard), hard).is_err() {
        log::warn!(
            "this process may have only {soft} descriptors, and a flood of connections may take \
             them all"
        );
    }
}
