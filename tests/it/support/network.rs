//! Two machines of our own and a cable between them: network namespaces, so that a packet is really
//! lost and a cable really pulled.
//!
//! Nothing of it has a name on this machine, and all of it goes when the test does, however it
//! ends: a namespace lives as long as the process that keeps it, and that ends with the pipe on
//! which it waits.
//!
//! # What we count on
//!
//! - iproute2, and nftables where packets are lost; root's rights, or user namespaces.
//! - These kernels have no netem. Loss is nft's random numbers at the receiver of either side; a
//!   slow cable is tc's token bucket.

use std::process::{Child, Command, Stdio};

use super::pass_over;
use super::real_time::Pace;

/// Where the brick is on the cable.
pub const BRICK: &str = "10.77.0.1";

/// The name of each side's end of the cable.
const CABLE: &str = "cable";

/// One machine: a process that keeps its namespaces.
struct Machine(Child);

impl Machine {
    /// In the user namespace of another one, where there has to be one.
    fn new(beside: Option<&Self>) -> Option<Self> {
        let mut command = match beside {
            Some(other) => other.command("unshare"),
            None => Command::new("unshare"),
        };
        if beside.is_none() && !nix::unistd::geteuid().is_root() {
            command.arg("--map-root-user");
        }
        // `echo` says that the namespace is there; `read` ends with the pipe.
        command.args(["--net", "sh", "-c", "echo there; read end"]);
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().ok()?;
        let mut said = String::new();
        let mut output = std::io::BufReader::new(child.stdout.take()?);
        std::io::BufRead::read_line(&mut output, &mut said).ok()?;
        (said == "there\n").then_some(Self(child))
    }

    /// A program on this machine, first at the processor where the kernel grants that.
    fn command(&self, program: &str) -> Command {
        let mut command = Pace::command("nsenter");
        command.arg("--target").arg(self.0.id().to_string()).arg("--net");
        if !nix::unistd::geteuid().is_root() {
            command.args(["--user", "--preserve-credentials"]);
        }
        command.arg("--").arg(program);
        command
    }

    /// Runs something here; why it did not work out.
    fn run(&self, line: &str) -> Result<(), String> {
        let mut words = line.split(' ');
        let output = self.command(words.next().unwrap_or_default()).args(words).output();
        let output = output.map_err(|error| error.to_string())?;
        let error = String::from_utf8_lossy(&output.stderr);
        if output.status.success() { Ok(()) } else { Err(format!("{line}: {}", error.trim())) }
    }

    #[track_caller]
    fn must(&self, line: &str) {
        self.run(line).unwrap_or_else(|error| panic!("{error}"));
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        drop(self.0.stdin.take());
        let _ = self.0.wait();
    }
}

/// A brick's machine and a PC's.
pub struct Network {
    brick: Machine,
    pc: Machine,
}

impl Network {
    /// `None`, and said, where this machine has no such thing.
    pub fn new() -> Option<Self> {
        let network = Self::try_new();
        if let Err(error) = &network {
            pass_over(&format!("network namespaces, with ip of iproute2 ({error})"));
        }
        network.ok()
    }

    fn try_new() -> Result<Self, String> {
        let refused = || "unshare --net is refused".to_owned();
        let brick = Machine::new(None).ok_or_else(refused)?;
        let pc = Machine::new(Some(&brick)).ok_or_else(refused)?;
        let peer = pc.0.id();
        brick.run(&format!("ip link add {CABLE} type veth peer name {CABLE} netns {peer}"))?;
        for (machine, address) in [(&brick, BRICK), (&pc, "10.77.0.2")] {
            machine.run(&format!("ip address add {address}/24 dev {CABLE}"))?;
            machine.run("ip link set lo up")?;
            machine.run(&format!("ip link set {CABLE} up"))?;
        }
        Ok(Self { brick, pc })
    }

    /// A program on the brick's machine.
    pub fn brick(&self, program: &str) -> Command {
        self.brick.command(program)
    }

    /// A program on the PC.
    pub fn pc(&self, program: &str) -> Command {
        self.pc.command(program)
    }

    /// Gives the brick's machine another address: another brick, for who looks from the PC.
    #[track_caller]
    pub fn add_address(&self, address: &str) {
        self.brick.must(&format!("ip address add {address}/24 dev {CABLE}"));
    }

    /// Pulls the cable out at the brick.
    pub fn pull(&self) {
        self.brick.must(&format!("ip link set {CABLE} down"));
    }

    /// Plugs it in again.
    pub fn plug(&self) {
        self.brick.must(&format!("ip link set {CABLE} up"));
        // That has replaced the route: set its congestion control again.
        self.congestion();
    }

    /// Loses this percentage of packets, each way. On a machine without nft: a message, and false.
    #[must_use]
    pub fn losing(&self, percent: u32) -> bool {
        let rules = [
            "nft add table ip losses",
            "nft add chain ip losses arriving { type filter hook input priority 0 ; }",
            &format!(
                "nft add rule ip losses arriving iifname {CABLE} numgen random mod 100 < \
                 {percent} drop"
            ),
        ];
        let made = [&self.brick, &self.pc].iter().try_for_each(|machine| {
            // Whatever was before; the first time there is nothing.
            let _ = machine.run("nft delete table ip losses");
            rules.iter().try_for_each(|rule| machine.run(rule))
        });
        if let Err(error) = &made {
            pass_over(&format!("losses by nftables ({error})"));
        }
        made.is_ok()
    }

    /// Limits the brick's uplink to this many Mbit/s. On a kernel without the token bucket: a
    /// message, and false.
    #[must_use]
    pub fn shaped(&self, mbit_per_s: u32) -> bool {
        let tbf = format!(
            "tc qdisc add dev {CABLE} root tbf rate {mbit_per_s}mbit burst 32kbit latency 50ms"
        );
        let shaped = self.brick.run(&tbf);
        if let Err(error) = &shaped {
            pass_over(&format!("a token bucket ({error})"));
        }
        shaped.is_ok()
    }

    /// Both sides answer congestion as the brick's kernel does, by cubic; which way it is by now.
    pub fn congestion(&self) -> &'static str {
        // By the route, because not every machine lets a namespace choose its usual way.
        let route = format!("ip route replace 10.77.0.0/24 dev {CABLE} congctl cubic");
        let is_cubic = self.brick.run(&route).is_ok() && self.pc.run(&route).is_ok();
        if is_cubic { "cubic" } else { "this machine's own" }
    }
}
