//! What makes a brick of an SD card: the scripts, the package's parts, the service's unit.
//!
//! What takes a Debian armel root or an emulated brick is in `tests/image/` and in
//! `brick-image/scenarios/`; `.ci/run` calls them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::support::pass_over;
#[cfg(feature = "host")]
use crate::support::tested_program;

/// The systemd of ev3dev's Debian 9.
const EV3DEV_SYSTEMD: u32 = 232;

/// The version of systemd that each directive of ours came in with, by its NEWS; 0 for those that
/// are older than version 200.
const DIRECTIVES: [(&str, u32); 44] = [
    ("Unit/Description", 0),
    ("Unit/Documentation", 0),
    ("Unit/After", 0),
    ("Unit/Wants", 0),
    ("Unit/Conflicts", 0),
    ("Unit/ConditionPathExists", 0),
    ("Unit/StartLimitIntervalSec", 230),
    ("Unit/StartLimitBurst", 229),
    ("Service/Type", 0),
    ("Service/NotifyAccess", 0),
    ("Service/ExecStartPre", 0),
    ("Service/ExecStart", 0),
    ("Service/ExecStopPost", 0),
    ("Service/Restart", 0),
    ("Service/RestartSec", 0),
    ("Service/RestartPreventExitStatus", 189),
    ("Service/WatchdogSec", 0),
    ("Service/TimeoutStartSec", 0),
    ("Service/TimeoutStopSec", 0),
    ("Service/KillMode", 0),
    ("Service/StandardInput", 0),
    ("Service/StandardOutput", 0),
    ("Service/TTYPath", 0),
    ("Service/TTYReset", 0),
    ("Service/User", 0),
    ("Service/Group", 0),
    ("Service/RuntimeDirectory", 211),
    ("Service/RuntimeDirectoryMode", 211),
    ("Service/UMask", 0),
    ("Service/LimitRTPRIO", 0),
    ("Service/LimitMEMLOCK", 0),
    ("Service/LimitNOFILE", 0),
    ("Service/LimitCORE", 0),
    ("Service/TasksMax", 227),
    ("Service/MemoryMax", 231),
    ("Service/OOMScoreAdjust", 0),
    ("Service/NoNewPrivileges", 0),
    ("Service/CapabilityBoundingSet", 0),
    ("Service/ProtectSystem", 214),
    ("Service/ProtectSystem=strict", 232),
    ("Service/ReadWritePaths", 231),
    ("Service/ProtectHome", 214),
    ("Service/PrivateTmp", 0),
    ("Install/WantedBy", 0),
];

fn brick_image() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("brick-image")
}

/// `Section/Key` and the value of each line of a unit.
fn directives(text: &str) -> Vec<(String, String)> {
    let mut section = String::new();
    let mut found = Vec::new();
    for line in
        text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'))
    {
        if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
            name.clone_into(&mut section);
        } else {
            let (key, value) =
                line.split_once('=').unwrap_or_else(|| panic!("no directive: {line}"));
            found.push((format!("{section}/{key}"), value.to_owned()));
        }
    }
    found
}

/// What a unit has that a systemd of this version does not know, or that the table does not.
fn unknown(unit: &str, version: u32) -> Vec<String> {
    let table = BTreeMap::from(DIRECTIVES);
    let since = |directive: &str| table.get(directive).copied();
    let too_new = |(key, value): &(String, String)| {
        let with_value = since(&format!("{key}={value}")).unwrap_or(0);
        since(key).is_none_or(|since| since.max(with_value) > version)
    };
    directives(unit)
        .iter()
        .filter(|directive| too_new(directive))
        .map(|(key, value)| format!("{key}={value}"))
        .collect()
}

#[test]
fn units_have_no_directive_that_ev3devs_systemd_does_not_know() {
    for unit in ["onbrick.service", "onbrick-menu.service", "onbrick-install.service"] {
        let text = std::fs::read_to_string(brick_image().join("package").join(unit)).unwrap();
        assert!(directives(&text).len() > 5, "{unit} was read");
        assert_eq!(unknown(&text, EV3DEV_SYSTEMD), [""; 0], "{unit}");
    }
    let text = std::fs::read_to_string(brick_image().join("package/onbrick.service")).unwrap();
    assert_eq!(
        unknown(&text, 231),
        ["Service/ProtectSystem=strict"],
        "the table tells versions apart"
    );
    let newer = text.replace("PrivateTmp", "StateDirectory");
    assert_eq!(unknown(&newer, EV3DEV_SYSTEMD), ["Service/StateDirectory=yes"]);
}

#[test]
fn the_service_stops_by_a_limit_and_sees_the_devices() {
    let text = std::fs::read_to_string(brick_image().join("package/onbrick.service")).unwrap();
    let directives: BTreeMap<_, _> = directives(&text).into_iter().collect();
    for (key, value) in [
        ("Service/Type", "notify"),
        ("Service/KillMode", "control-group"),
        ("Service/Restart", "on-failure"),
        ("Service/NoNewPrivileges", "yes"),
        ("Service/ExecStart", "/usr/bin/onbrick serve"),
    ] {
        assert_eq!(directives.get(key).map(String::as_str), Some(value), "{key}");
    }
    for key in [
        "Service/WatchdogSec",
        "Unit/StartLimitBurst",
        "Service/ExecStopPost",
        "Service/LimitRTPRIO",
    ] {
        assert!(directives.contains_key(key), "{key}");
    }
    // Under these, /sys is read-only or /dev has neither screen nor buttons.
    for key in
        ["Service/ProtectKernelTunables", "Service/PrivateDevices", "Service/RestrictRealtime"]
    {
        assert!(!directives.contains_key(key), "{key}");
    }
}

/// Every shell script of the project, with the dialect that shellcheck cannot see by itself.
fn scripts() -> Vec<(PathBuf, Option<&'static str>)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = vec![(root.join(".ci/run"), None)];
    let mut folders = vec![brick_image(), root.join("tests/image")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let text = std::fs::read(&path).unwrap();
            let is_script = path.extension().is_some_and(|ending| ending == "sh")
                || text.starts_with(b"#!/bin/");
            if is_script {
                // busybox's shell is closest to dash.
                found.push((path, text.starts_with(b"#!/bin/busybox").then_some("dash")));
            }
        }
    }
    found.sort();
    found
}

#[test]
fn shellcheck_finds_nothing_in_any_script() {
    if Command::new("shellcheck").arg("--version").output().is_err() {
        return pass_over("the shell scripts (no shellcheck)");
    }
    let scripts = scripts();
    assert!(scripts.len() > 15, "{scripts:?}");
    for (path, dialect) in scripts {
        let mut shellcheck = Command::new("shellcheck");
        shellcheck.arg("-x");
        if let Some(dialect) = dialect {
            shellcheck.args(["-s", dialect]);
        }
        let checked = shellcheck.arg(&path).output().unwrap();
        assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stdout));
    }
}

fn script(name: &str, arguments: &[&str]) -> Output {
    Command::new(brick_image().join(name)).args(arguments).output().unwrap()
}

#[test]
fn every_script_for_people_explains_itself_and_refuses_nonsense() {
    for name in ["emulate.sh", "inject.sh", "install.sh", "package.sh", "release.sh"] {
        let help = script(name, &["--help"]);
        let text = String::from_utf8(help.stdout).unwrap();
        assert!(help.status.success() && text.starts_with("Usage: brick-image/"), "{name}: {text}");
        let refused = script(name, &["--no-such-option"]);
        assert_eq!(refused.status.code(), Some(2), "{name}");
        let said = String::from_utf8_lossy(&refused.stderr);
        assert!(said.contains("Usage: "), "{name}: {said}");
        // Of its places none begins with a dash that could be mistyped.
        let names_it = said.starts_with("error: there is no option --no-such-option\n");
        assert!(names_it || name == "package.sh", "{name}: {said}");
    }
    for (name, arguments) in [
        ("build.sh", &["--for"][..]),
        ("emulate.sh", &["--out"]),
        ("inject.sh", &["ev3dev.img", "--key"]),
        ("install.sh", &["ev3dev.local", "--name"]),
    ] {
        let refused = script(name, arguments);
        let said = String::from_utf8_lossy(&refused.stderr);
        let option = arguments.last().unwrap();
        assert!(said.starts_with(&format!("error: {option} needs a value\n\nUsage: ")), "{said}");
        assert_eq!(refused.status.code(), Some(2), "{name}");
    }
}

#[test]
fn the_package_has_everything_in_its_place() {
    if Command::new("dpkg-deb").arg("--version").output().is_err() {
        return pass_over("the package (no dpkg-deb)");
    }
    let folder = tempfile::tempdir().unwrap();
    let binary = folder.path().join("onbrick");
    std::fs::write(&binary, "stands for the brick's program").unwrap();
    let out = folder.path().display().to_string();
    let made = script("package.sh", &[&binary.display().to_string(), "1.2.3", &out]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let package = folder.path().join("onbrick_1.2.3_armel.deb");
    let dpkg_deb = |arguments: &[&str]| {
        let said = Command::new("dpkg-deb").args(arguments).arg(&package).output().unwrap();
        String::from_utf8(said.stdout).unwrap()
    };
    let listing = dpkg_deb(&["--contents"]);
    for (mode, path) in [
        ("-rwxr-xr-x root/root", "./usr/bin/onbrick"),
        ("-rw-r--r-- root/root", "./lib/systemd/system/onbrick.service"),
        ("-rw-r--r-- root/root", "./lib/systemd/system/onbrick-menu.service"),
        ("-rw-r--r-- root/root", "./etc/onbrick/onbrick.toml"),
        ("-rw-r--r-- root/root", "./etc/avahi/services/onbrick.service"),
        ("-rw-r--r-- root/root", "./usr/share/onbrick/robot.toml"),
        ("-rw-r--r-- root/root", "./usr/share/onbrick/missions/map.toml"),
        ("-rwxr-xr-x root/root", "./usr/share/onbrick/onbrick-menu"),
        ("-rwxr-xr-x root/root", "./usr/lib/onbrick/check"),
    ] {
        let line = listing.lines().find(|line| line.ends_with(&format!(" {path}")));
        assert!(line.is_some_and(|line| line.starts_with(mode)), "{path}: {line:?} in\n{listing}");
    }
    let fields = Command::new("dpkg-deb").arg("--field").arg(&package).output().unwrap();
    let fields = String::from_utf8(fields.stdout).unwrap();
    for field in ["Package: onbrick", "Version: 1.2.3", "Architecture: armel"] {
        assert!(fields.lines().any(|line| line == field), "{field} in {fields}");
    }
    let made = script("package.sh", &[&binary.display().to_string(), "1.2.3", &out, "armhf"]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let other = folder.path().join("onbrick_1.2.3_armhf.deb");
    let field = Command::new("dpkg-deb").arg("--field").arg(other).arg("Architecture").output();
    assert_eq!(field.unwrap().stdout, b"armhf\n");
    let first = std::fs::read(&package).unwrap();
    assert!(script("package.sh", &[&binary.display().to_string(), "1.2.3", &out]).status.success());
    assert!(first == std::fs::read(&package).unwrap(), "the same input makes the same package");
    // Debian 9's dpkg reads xz and not zstd.
    let members = Command::new("ar")
        .arg("t")
        .arg(&package)
        .output()
        .map(|said| said.stdout)
        .unwrap_or_default();
    assert!(
        members.is_empty() || String::from_utf8_lossy(&members).contains("data.tar.xz"),
        "compressed for Debian 9"
    );
}

#[test]
#[cfg(feature = "host")]
fn the_package_for_a_pc_has_the_program_its_manual_and_completions() {
    if Command::new("dpkg-deb").arg("--version").output().is_err() {
        return pass_over("the package (no dpkg-deb)");
    }
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name).display().to_string();
    let (binary, out, share) = (place("onbrick"), place(""), place("made"));
    std::fs::write(&binary, "stands for the program").unwrap();
    let package = || script("package.sh", &[&binary, "1.2.3", &out, "amd64", &share]);
    assert!(String::from_utf8_lossy(&package().stderr).contains("try: onbrick manual"));
    let pages = Command::new(tested_program()).args(["manual", &share]).output().unwrap();
    assert!(pages.status.success());
    let made = package();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let package = folder.path().join("onbrick_1.2.3_amd64.deb");
    let said = |option| {
        let said = Command::new("dpkg-deb").arg(option).arg(&package).output().unwrap();
        String::from_utf8(said.stdout).unwrap()
    };
    let listing = said("--contents");
    for path in [
        "./usr/bin/onbrick",
        "./usr/share/man/man1/onbrick-run.1.gz",
        "./usr/share/bash-completion/completions/onbrick",
        "./usr/share/zsh/vendor-completions/_onbrick",
        "./usr/share/fish/vendor_completions.d/onbrick.fish",
    ] {
        assert!(listing.lines().any(|line| line.ends_with(path)), "{path} is not in\n{listing}");
    }
    assert!(!listing.contains("service"), "a brick's service: {listing}");
    let fields = said("--field");
    for field in ["Architecture: amd64", "Recommends: fuse3"] {
        assert!(fields.lines().any(|line| line == field), "{field} in {fields}");
    }
}

/// What `install.sh` says to a brick whose shell answers so about its processor, Debian's word for
/// it, and its image; it never gets further than to copying.
fn installs(machine: [&str; 3], deb: Option<&str>) -> (Option<i32>, String) {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        std::fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o755))
            .unwrap();
    };
    let words = machine.map(|word| format!("'{word}'")).join(" ");
    let ssh = format!(
        "#!/bin/bash\ncase \"${{*: -1}}\" in\n*'uname -m'*) printf '%s\\n' {words} ;;\n\
         *'cat >'*) exit 9 ;;\nesac\n"
    );
    put("ssh", &ssh);
    put(
        "brick-image/install.sh",
        &std::fs::read_to_string(brick_image().join("install.sh")).unwrap(),
    );
    put("target/brick/onbrick_1.2.3_armel.deb", "!<arch>\n");
    let mut install = Command::new(folder.path().join("brick-image/install.sh"));
    install.args(["--no-key", "red.local"]);
    if let Some(deb) = deb {
        put(deb, "!<arch>\n");
        install.arg("--deb").arg(folder.path().join(deb));
    }
    let path = format!("{}:{}", folder.path().display(), std::env::var("PATH").unwrap());
    let said = install.env("PATH", path).stdin(std::process::Stdio::null()).output().unwrap();
    (said.status.code(), String::from_utf8_lossy(&said.stderr).into_owned())
}

#[test]
fn install_takes_the_package_for_the_boards_processor() {
    let ev3 = ["armv5tejl", "armel", "ev3dev-stretch-ev3-generic"];
    let pi = ["armv7l", "armhf", "ev3dev-stretch-rpi2-generic"];
    let arrives = "the package did not arrive whole";
    for (machine, deb, code, says) in [
        (ev3, None, 1, arrives),
        (pi, None, 1, "there is no package for armhf"),
        (pi, None, 1, "try: brick-image/build.sh --for armv7"),
        (pi, Some("onbrick_1.2.3_armhf.deb"), 1, arrives),
        (["aarch64", "armhf", "ev3dev"], Some("mine.deb"), 1, arrives),
        (pi, Some("onbrick_1.2.3_armel.deb"), 1, "which takes armhf"),
        (ev3, Some("onbrick_1.2.3_armhf.deb"), 1, "which takes armel"),
        (["armv6l", "armhf", "ev3dev-stretch-rpi-generic"], None, 3, "is no board that onbrick"),
        (["x86_64", "amd64", "unknown"], None, 3, "is no board that onbrick"),
    ] {
        let (ended, said) = installs(machine, deb);
        assert_eq!(ended, Some(code), "{machine:?}, {deb:?}: {said}");
        assert!(said.contains(says), "{machine:?}, {deb:?}: {said}");
    }
}

#[test]
fn an_image_that_is_not_ev3devs_is_refused_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let image = folder.path().join("photo.img");
    std::fs::write(&image, vec![7_u8; 100_000]).unwrap();
    let deb = folder.path().join("fake.deb");
    std::fs::write(&deb, "!<arch>\n").unwrap();
    let said =
        script("inject.sh", &[&image.display().to_string(), "--deb", &deb.display().to_string()]);
    let text = String::from_utf8_lossy(&said.stderr).into_owned();
    if text.contains("this needs") {
        return pass_over("refusing an image that is none (no mtools, e2fsprogs or fdisk)");
    }
    assert_eq!(said.status.code(), Some(1), "{text}");
    assert!(text.contains("is no SD card image") && text.contains("try: "), "{text}");
    assert!(std::fs::read(&image).unwrap() == vec![7_u8; 100_000], "it was left alone");
}

/// Makes an image as ev3dev's, of which there is only what `inject.sh` looks at: `image FOLDER
/// ARCHITECTURE KERNEL`.
const TINY_IMAGE: &str = r#"
cd "$1"
PATH=$PATH:/usr/sbin:/sbin
mkdir -p root/etc root/var/lib/dpkg
echo ev3dev-stretch >root/etc/ev3dev-release
printf 'Package: base\nArchitecture: all\n\nPackage: dpkg\nArchitecture: %s\n\n' "$2" \
  >root/var/lib/dpkg/status
truncate -s 96M image
printf '2048,16384,c\n18432,,83\n' | sfdisk -q image
truncate -s 8M boot
mkfs.vfat boot >/dev/null
echo kernel >"$3"
mcopy -i boot "$3" "::$3"
dd if=boot of=image bs=512 seek=2048 conv=notrunc status=none
mke2fs -q -t ext4 -d root -E offset=$((18432 * 512)) image $((96 * 1024 - 9216))k
"#;

#[test]
fn inject_takes_the_package_for_the_images_board() {
    for (architecture, kernel, deb, says) in [
        ("armhf", "kernel7.img", "onbrick_1.2.3_armhf.deb", "put onbrick_1.2.3_armhf.deb into"),
        ("armel", "uImage", "onbrick_1.2.3_armel.deb", "put onbrick_1.2.3_armel.deb into"),
        ("armhf", "kernel7.img", "onbrick_1.2.3_armel.deb", "it takes armhf"),
        ("armhf", "kernel7.img", "", "there is no package for armhf in"),
        ("amd64", "uImage", "", "for a processor that onbrick is not built for: amd64"),
        ("armhf", "vmlinuz", "", "there is no kernel for an EV3 (uImage) or a Raspberry Pi 2"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).display().to_string();
        let made = Command::new("bash")
            .args(["-euo", "pipefail", "-c", TINY_IMAGE, "image", &path(""), architecture, kernel])
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&made.stderr).into_owned();
        if text.contains("command not found") {
            return pass_over(
                "an image for each board (no mtools, dosfstools, e2fsprogs or fdisk)",
            );
        }
        assert!(made.status.success(), "{text}");
        // From where no package was built.
        std::fs::create_dir(path("scripts")).unwrap();
        std::fs::copy(brick_image().join("inject.sh"), path("scripts/inject.sh")).unwrap();
        let package = brick_image().join("package").display().to_string();
        std::os::unix::fs::symlink(package, path("scripts/package")).unwrap();
        let mut inject = Command::new(path("scripts/inject.sh"));
        inject.arg(path("image"));
        if !deb.is_empty() {
            std::fs::write(path(deb), "!<arch>\n").unwrap();
            inject.args(["--deb", &path(deb)]);
        }
        let said = inject.output().unwrap();
        let all = [said.stdout, said.stderr].concat();
        let text = String::from_utf8_lossy(&all);
        assert!(text.contains(says), "{architecture}, {kernel}, {deb}: {text}");
        assert_eq!(said.status.success(), says.starts_with("put "), "{text}");
    }
}

#[test]
fn scripts_wait_for_apts_lock_and_name_what_could_not_be_installed() {
    let folder = tempfile::tempdir().unwrap();
    let script = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, format!("#!/bin/bash\n{text}\n")).unwrap();
        std::fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o755))
            .unwrap();
    };
    // The lists are locked twice; what is installed is noted.
    script(
        "apt-get",
        "cd \"$HOME\"\nif [[ $* == *update* ]]; then\n  echo x >>tried\n  [ \"$(wc -l <tried)\" \
         -gt 2 ] || \
         { echo 'E: Could not get lock /var/lib/apt/lists/lock' >&2; exit 100; }\n\
         elif [[ $* == *no-such-package* ]]; then\n  echo 'E: Unable to locate package' >&2; exit \
         100\n\
         else echo \"$*\" >installed\nfi",
    );
    script("sudo", "exec \"$@\"");
    let needs = |pairs: &str| {
        let sourced = format!(
            "source {}/brick-image/emulator/common.sh; needs {pairs}",
            env!("CARGO_MANIFEST_DIR")
        );
        let path = format!("{}:{}", folder.path().display(), std::env::var("PATH").unwrap());
        let mut bash = Command::new("bash");
        bash.args(["-euo", "pipefail", "-c", &sourced])
            .env("PATH", path)
            .env("HOME", folder.path());
        bash.env_remove("XDG_CACHE_HOME").output().unwrap()
    };
    let said = needs("ls=coreutils no-such-command=fdisk");
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    assert_eq!(read("tried").lines().count(), 3, "it was tried until the lock was free");
    let installed = read("installed");
    assert!(
        installed.ends_with(" fdisk\n") && installed.contains("DPkg::Lock::Timeout=600"),
        "{installed}"
    );
    let said = needs("no-such-command=no-such-package");
    let text = String::from_utf8_lossy(&said.stderr);
    assert!(
        !said.status.success() && text.contains("could not install no-such-package: E: Unable"),
        "{text}"
    );
}
