//! Bricks to be asked: a door with operations of the test's own, and the real service.

use std::collections::BTreeMap;
use std::os::unix::fs::MetadataExt;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use onbrick::link::keys::Authorised;
use onbrick::link::{
    Client, KeyPair, KnownBrick, KnownBricks, LinkState, Patience, PublicKey, Server, ServerConfig,
};
use onbrick::protocol::{
    Answer, Caller, Disk, Done, Fetch, Fetched, Kind, Live, LiveDevice, LocalOnly, Missions, Name,
    Operations, Refusal, Request, RunId, Runs, Started, State, Status, Stopped,
};
use onbrick::service::config::LinkConfig;
use sha2::{Digest as _, Sha256};
use tempfile::TempDir;

use crate::support::real_time::Pace;
use crate::support::{OTHER_USER, copy_of_program, own_address, tested_program};

/// Nothing here takes this long on any machine, and nothing waits for it to be over.
pub const LONG: Duration = Duration::from_secs(60);

/// Waits until something is so.
#[track_caller]
pub fn until<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let begun = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(begun.elapsed() < LONG, "waited in vain: {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// A recording on a fake brick.
#[derive(Debug, Clone, Default)]
pub struct Recording {
    pub bytes: Vec<u8>,
    pub complete: bool,
}

/// Operations that answer at once and keep what they were asked.
#[derive(Debug, Default)]
pub struct Fake {
    pub asked: Mutex<Vec<(String, Caller)>>,
    pub recordings: Mutex<BTreeMap<String, Recording>>,
    /// How many starts are refused for a stale token.
    pub stale: AtomicU32,
    /// How long a mission's list takes, milliseconds.
    pub slow_ms: AtomicU32,
    /// An operation that is not answered while its name stands here.
    pub hangs: Mutex<Option<&'static str>>,
    /// What it says of its clock.
    pub clock: Mutex<Option<String>>,
    pub started: Mutex<Vec<RunId>>,
    pub devices: Mutex<Vec<LiveDevice>>,
    /// The hashes that clients have named.
    hashes: Mutex<Vec<String>>,
}

impl Fake {
    pub fn record(&self, run: &str, bytes: Vec<u8>, complete: bool) {
        self.recordings.lock().unwrap().insert(run.to_owned(), Recording { bytes, complete });
    }

    /// The hashes that clients have named, of what lies on their disks.
    pub fn told(&self) -> Vec<String> {
        self.hashes.lock().unwrap().clone()
    }

    fn status(&self) -> Status {
        Status {
            brick: "fake".to_owned(),
            version: "0".to_owned(),
            protocol: 1,
            state: State::Ready,
            state_s: 0.0,
            run: None,
            last: None,
            battery_v: Some(7.5),
            simulated: false,
            token: "t".to_owned(),
            link: "ready".to_owned(),
            disk: Disk { used: 0, quota: 0, free: 0 },
            battery: None,
            taken: None,
            robot: None,
            clock: self.clock.lock().unwrap().clone(),
        }
    }

    fn fetch(&self, fetch: &Fetch) -> Result<Answer, Refusal> {
        self.hashes.lock().unwrap().extend(fetch.sha256.clone());
        let recordings = self.recordings.lock().unwrap();
        let found = recordings.get(fetch.run.as_str());
        let recording =
            found.ok_or_else(|| Refusal::new(Kind::UnknownRun, format!("no run {}", fetch.run)))?;
        let (offset, total) = (usize::try_from(fetch.offset).unwrap(), recording.bytes.len());
        if offset > total {
            return Err(Refusal::new(Kind::BeyondEnd, format!("{offset} is beyond {total}")));
        }
        let end = total.min(offset + usize::try_from(fetch.length).unwrap());
        let bytes = recording.bytes[offset..end].to_vec();
        let is_end = recording.complete && end == total;
        let hash =
            || Sha256::digest(&recording.bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        let fetched = Fetched {
            run: fetch.run.clone(),
            offset: fetch.offset,
            length: u32::try_from(bytes.len()).unwrap(),
            total: u64::try_from(total).unwrap(),
            complete: recording.complete,
            sha256: is_end.then(hash),
        };
        Ok(Answer { value: serde_json::to_value(fetched).unwrap(), bytes: Some(bytes) })
    }
}

impl Operations for Fake {
    fn shared(&self, request: &Request, caller: &Caller) -> Result<Answer, Refusal> {
        let op = serde_json::to_value(request).unwrap()["op"].as_str().unwrap().to_owned();
        self.asked.lock().unwrap().push((op.clone(), caller.clone()));
        let asked = Instant::now();
        while *self.hangs.lock().unwrap() == Some(op.as_str()) && asked.elapsed() < LONG {
            std::thread::sleep(Duration::from_millis(5));
        }
        let value = match request {
            Request::Status => serde_json::to_value(self.status()),
            Request::Missions => {
                let slow_ms = self.slow_ms.load(Ordering::Relaxed);
                std::thread::sleep(Duration::from_millis(u64::from(slow_ms)));
                serde_json::to_value(Missions { missions: Vec::new() })
            }
            Request::Start(start) => {
                if self.stale.load(Ordering::Relaxed) > 0 {
                    self.stale.fetch_sub(1, Ordering::Relaxed);
                    return Err(Refusal::new(Kind::StaleToken, "the token is old"));
                }
                let mut started = self.started.lock().unwrap();
                let repeated = started.contains(&start.run);
                started.push(start.run.clone());
                serde_json::to_value(Started { run: start.run.clone(), repeated, limited_s: None })
            }
            Request::Stop { run } => {
                serde_json::to_value(Stopped { run: run.clone(), stopped: true, other: None })
            }
            Request::Runs => serde_json::to_value(Runs { runs: Vec::new() }),
            Request::Identify => serde_json::to_value(Done {}),
            Request::Live => {
                serde_json::to_value(Live { devices: self.devices.lock().unwrap().clone() })
            }
            Request::Fetch(fetch) => return self.fetch(fetch),
        };
        Ok(Answer { value: value.unwrap(), bytes: None })
    }

    fn own(&self, _request: &LocalOnly, _caller: &Caller) -> Result<Answer, Refusal> {
        panic!("nothing of the local door's comes over the network");
    }
}

/// A door in this process, before a fake brick.
pub struct Bench {
    pub folder: TempDir,
    pub fake: Arc<Fake>,
    pub server: Server,
    pub pc: KeyPair,
}

impl Bench {
    /// A brick that knows one PC, called `pc`.
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let pc = KeyPair::generate().unwrap();
        Authorised::below(folder.path()).add(&pc.public(), "pc").unwrap();
        let fake = Arc::new(Fake::default());
        let server = serve(folder.path(), &fake);
        Self { folder, fake, server, pc }
    }

    pub fn authorised(&self) -> Authorised {
        Authorised::below(self.folder.path())
    }

    pub fn brick_key(&self) -> PublicKey {
        KeyPair::load(self.folder.path()).unwrap().public()
    }

    pub fn address(&self) -> String {
        format!("127.0.0.1:{}", self.server.port())
    }

    pub fn client(&self) -> Client {
        self.client_of(&self.pc)
    }

    pub fn client_of(&self, own: &KeyPair) -> Client {
        client_at(&self.address(), self.brick_key(), own)
    }

    /// A socket of libzmq with the PC's key, for what no client of ours would say.
    pub fn raw(&self, kind: zmq::SocketType) -> (zmq::Context, zmq::Socket) {
        let context = zmq::Context::new();
        let socket = context.socket(kind).unwrap();
        let (public, secret) = halves(&self.pc);
        socket.set_curve_serverkey(self.brick_key().as_bytes()).unwrap();
        socket.set_curve_publickey(&public).unwrap();
        socket.set_curve_secretkey(&secret).unwrap();
        socket.set_linger(0).unwrap();
        socket.set_rcvtimeo(30_000).unwrap();
        socket.set_sndtimeo(30_000).unwrap();
        socket.connect(&format!("tcp://{}", self.address())).unwrap();
        (context, socket)
    }
}

/// Both halves of a pair, by way of its file.
pub fn halves(pair: &KeyPair) -> (Vec<u8>, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let path = pair.save(folder.path()).unwrap();
    let text = std::fs::read_to_string(path).unwrap();
    let half = |name: &str| {
        let line = text.lines().find(|line| line.starts_with(name)).unwrap();
        zmq::z85_decode(line.split('"').nth(1).unwrap()).unwrap()
    };
    (half("public"), half("secret"))
}

pub fn serve(folder: &Path, fake: &Arc<Fake>) -> Server {
    let config = ServerConfig {
        keys: folder.to_owned(),
        name: Name::new("fake").unwrap(),
        listens: LinkConfig { address: "127.0.0.1".to_owned(), port: 0, pairing_port: 0 },
    };
    let server = Server::start(config, Arc::clone(fake) as Arc<dyn Operations>).unwrap();
    until("the link is ready", || match server.state() {
        LinkState::Ready { .. } => Some(()),
        LinkState::Ended(why) => panic!("{why}"),
        LinkState::Waits(_) => None,
    });
    server
}

pub fn client_at(address: &str, key: PublicKey, own: &KeyPair) -> Client {
    Client::new(address, key, own).unwrap().with_patience(Patience::new(LONG.as_secs_f64()))
}

/// The real service with a simulated brick, in a process of its own, and a PC that knows it.
pub struct Service {
    pub folder: TempDir,
    pub address: String,
    pub name: String,
    /// Where its robot is: arguments of `serve`.
    place: Vec<String>,
    /// What the service's process has in its environment besides.
    pub environment: Vec<(&'static str, PathBuf)>,
    child: Option<Child>,
}

impl Service {
    /// Serves at a loopback address that no other process of this machine has.
    pub fn new() -> Self {
        Self::of("sim", &["--sim", "arena"])
    }

    /// The same with a name and a robot of its own.
    pub fn of(name: &str, place: &[&str]) -> Self {
        Self::below(tempfile::tempdir().unwrap(), name, place)
    }

    /// The same of another user than these tests', as the package has it; `None` where that is not
    /// permitted.
    pub fn of_another_user(name: &str, place: &[&str]) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        std::os::unix::fs::chown(folder.path(), Some(OTHER_USER), Some(OTHER_USER)).ok()?;
        Some(Self::below(folder, name, place))
    }

    /// Serves as the user whose folder it is.
    fn below(folder: TempDir, name: &str, place: &[&str]) -> Self {
        let address = own_address();
        let config = format!("name = \"{name}\"\n[link]\naddress = \"{address}\"\n");
        std::fs::write(folder.path().join("onbrick.toml"), config).unwrap();
        let place = place.iter().map(|&argument| argument.to_owned()).collect();
        let name = name.to_owned();
        let mut service =
            Self { folder, address, name, place, environment: Vec::new(), child: None };
        service.start();
        service
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Gives the brick a mission of its own; those that are shipped are not offered then.
    pub fn mission(&self, name: &str, text: &str) {
        std::fs::create_dir_all(self.path("missions")).unwrap();
        std::fs::write(self.path("missions").join(format!("{name}.toml")), text).unwrap();
    }

    /// Starts the service's process and waits until its link is ready.
    pub fn start(&mut self) {
        let log = std::fs::File::create(self.path("log")).unwrap();
        let owner = std::fs::metadata(self.folder.path()).unwrap();
        // Where the tests' program is, the other user may have no access.
        let program = if owner.uid() == nix::unistd::geteuid().as_raw() {
            tested_program().to_owned()
        } else {
            copy_of_program(self.folder.path()).into_os_string().into_string().unwrap()
        };
        let child = Pace::command(&program)
            .uid(owner.uid())
            .gid(owner.gid())
            .envs(self.environment.iter().map(|(name, value)| (name, value)))
            .args(["-v", "serve", "--config"])
            .arg(self.folder.path())
            .args(&self.place)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(log)
            .spawn();
        self.child = Some(child.unwrap());
        until("the link listens", || {
            let log = self.log();
            let child = self.child.as_mut().unwrap();
            assert!(child.try_wait().unwrap().is_none(), "the service has ended: {log}");
            log.contains("the link listens").then_some(())
        });
    }

    pub fn log(&self) -> String {
        std::fs::read_to_string(self.path("log")).unwrap_or_default()
    }

    /// The most memory that the service's process has had, kB.
    pub fn peak_kb(&self) -> usize {
        let status = format!("/proc/{}/status", self.child.as_ref().unwrap().id());
        let status = std::fs::read_to_string(status).unwrap();
        let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap();
        line.split_whitespace().nth(1).unwrap().parse().unwrap()
    }

    /// Ends the service's process at once, as a brick ends whose battery is taken out.
    pub fn kill(&mut self) {
        if let Some(mut child) = self.child.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }

    /// Makes a PC with keys of its own and introduces the two to each other without a person.
    pub fn introduce(&self) {
        self.introduce_to(&self.path("pc"));
    }

    /// The same to a PC whose keys are in this folder.
    pub fn introduce_to(&self, folder: &Path) {
        let pc = KeyPair::load_or_make(folder).unwrap();
        Authorised::below(&self.path("keys")).add(&pc.public(), "anna").unwrap();
        let owner = std::fs::metadata(self.folder.path()).unwrap();
        let authorised = self.path("keys/authorised");
        let keys = std::fs::read_dir(&authorised).unwrap().map(|key| key.unwrap().path());
        for path in keys.chain([authorised.clone()]) {
            std::os::unix::fs::chown(path, Some(owner.uid()), Some(owner.gid())).unwrap();
        }
        let key = KeyPair::load(&self.path("keys")).unwrap().public();
        let brick = KnownBrick { name: self.name.clone(), address: self.address.clone(), key };
        KnownBricks::load(folder).unwrap().put(&brick, None).unwrap();
    }

    /// The service's process.
    pub fn process(&self) -> &Child {
        self.child.as_ref().unwrap()
    }

    /// A command of the PC's.
    pub fn pc(&self, arguments: &[&str]) -> Output {
        let folder = self.path("out");
        std::fs::create_dir_all(&folder).unwrap();
        onbrick()
            .env("ONBRICK_KEYS", self.path("pc"))
            .current_dir(folder)
            .args(arguments)
            .output()
            .unwrap()
    }

    /// The same, and it works out; its output.
    #[track_caller]
    pub fn done(&self, arguments: &[&str]) -> String {
        let output = self.pc(arguments);
        let (said, error) = (text(&output.stdout), text(&output.stderr));
        assert!(
            output.status.success(),
            "{arguments:?}: {said}{error}\nthe service: {}",
            self.log()
        );
        said
    }

    /// The same, and these words are in its output.
    #[track_caller]
    pub fn says(&self, arguments: &[&str], words: &str) -> String {
        let said = self.done(arguments);
        assert!(said.contains(words), "{arguments:?}: {said}\nthe service: {}", self.log());
        said
    }

    /// Waits until the run that was started drives, of which it must not have ended before; the
    /// status.
    #[track_caller]
    pub fn until_it_drives(&self) -> String {
        until("it drives", || {
            let status = self.done(&["status", &self.name]);
            assert!(
                !status.contains("last: "),
                "over already: {status}\nthe service: {}",
                self.log()
            );
            status.contains("running").then_some(status)
        })
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        self.kill();
    }
}

pub fn onbrick() -> Command {
    Command::new(tested_program())
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}
