//! The threads that ask the service: one for `stop`, one for everything else.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use super::ServerError;
use crate::link::if_ready;
use crate::protocol::{Answer, Asked, Caller, Id, Operations, Refusal, Reply, Request};
use crate::threads::spawn;

/// Where workers hand over what is to be sent.
const ENDPOINT: &str = "inproc://replies";

/// What a worker does.
#[derive(Debug)]
pub(super) struct Job {
    /// The frames that the reply begins with.
    pub(super) envelope: Vec<Vec<u8>>,
    /// What is asked.
    pub(super) asked: Asked<Request>,
    /// By whom.
    pub(super) name: String,
}

/// The workers. Dropping them lets them finish what they do.
pub(super) struct Workers {
    stop: Option<Sender<Job>>,
    rest: Option<Sender<Job>>,
    replies: zmq::Socket,
    threads: Vec<JoinHandle<()>>,
}

impl Workers {
    pub(super) fn start(
        context: &zmq::Context,
        operations: &Arc<dyn Operations>,
    ) -> Result<Self, ServerError> {
        let replies = context.socket(zmq::PULL)?;
        replies.set_linger(0)?;
        replies.bind(ENDPOINT)?;
        let mut workers = Self { stop: None, rest: None, replies, threads: Vec::new() };
        workers.stop = Some(workers.one(context, "link-stop", operations)?);
        workers.rest = Some(workers.one(context, "link-work", operations)?);
        Ok(workers)
    }

    fn one(
        &mut self,
        context: &zmq::Context,
        name: &str,
        operations: &Arc<dyn Operations>,
    ) -> Result<Sender<Job>, ServerError> {
        let replies = context.socket(zmq::PUSH)?;
        replies.set_linger(0)?;
        replies.connect(ENDPOINT)?;
        let (sender, jobs) = channel();
        let operations = Arc::clone(operations);
        let work = move || work(&jobs, &replies, &*operations);
        self.threads.push(spawn(name, work).map_err(ServerError::Thread)?);
        Ok(sender)
    }

    /// Hands a job over.
    pub(super) fn take(&self, job: Job) -> Result<(), ServerError> {
        let worker = match job.asked.request {
            Request::Stop { .. } => &self.stop,
            _ => &self.rest,
        };
        worker.as_ref().and_then(|worker| worker.send(job).ok()).ok_or(ServerError::NoWorker)
    }

    /// For `zmq::poll`.
    pub(super) fn poll_item(&self) -> zmq::PollItem<'_> {
        self.replies.as_poll_item(zmq::POLLIN)
    }

    /// The next reply with its envelope, if there is one.
    pub(super) fn done(&self) -> zmq::Result<Option<Vec<Vec<u8>>>> {
        if_ready(self.replies.recv_multipart(zmq::DONTWAIT))
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        (self.stop, self.rest) = (None, None);
        for thread in self.threads.drain(..) {
            // One that has panicked has said so itself.
            let _ = thread.join();
        }
    }
}

fn work(jobs: &Receiver<Job>, replies: &zmq::Socket, operations: &dyn Operations) {
    for Job { envelope, asked, name } in jobs {
        let answered = operations.shared(&asked.request, &Caller::Key(name));
        let frames = framed(envelope, Some(asked.id), answered);
        if replies.send_multipart(frames, 0).is_err() {
            return;
        }
    }
}

/// A reply's frames.
pub(super) fn framed(
    mut envelope: Vec<Vec<u8>>,
    id: Option<Id>,
    answered: Result<Answer, Refusal>,
) -> Vec<Vec<u8>> {
    let (reply, bytes) = Reply::to(id, answered);
    let json = serde_json::to_vec(&reply).unwrap_or_else(|error| {
        // Replies of ours are plain; what cannot be JSON would be a mistake in the program, and is
        // said as such.
        log::error!("a reply is no JSON: {error}");
        Vec::new()
    });
    envelope.push(json);
    envelope.extend(bytes);
    envelope
}
