//! `onbrick manual`: the manual's pages and the shells' completions, for packages and for those who
//! installed by `cargo install`.

use std::path::{Path, PathBuf};

use clap::Command;
use clap_complete::Shell;

use crate::cli::common::{make_folder, write_file};
use crate::cli::{Exit, Failure, Hint, Output};

/// Write the manual's pages, and completions for bash, zsh and fish, into the places below a folder
/// where they are looked for.
///
/// Examples:
///   onbrick manual ~/.local                 for you; then `man onbrick-run`
///   sudo onbrick manual /usr/local          for all who use this machine
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    /// The folder; the pages go to share/man/man1 in it.
    folder: PathBuf,
}

/// Each shell, and where it looks for its completions.
const SHELLS: [(Shell, &str); 3] = [
    (Shell::Bash, "share/bash-completion/completions/onbrick"),
    (Shell::Zsh, "share/zsh/site-functions/_onbrick"),
    (Shell::Fish, "share/fish/vendor_completions.d/onbrick.fish"),
];

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let described = crate::cli::described();
    let pages = arguments.folder.join("share/man/man1");
    make_folder(Exit::Failed, &pages).hint(OWN)?;
    let mut built = described.clone().disable_help_subcommand(true);
    built.build();
    clap_mangen::generate_to(with_usage(built), &pages).map_err(cannot_write(&pages))?;
    for page in std::fs::read_dir(&pages).map_err(cannot_write(&pages))?.flatten() {
        let text = std::fs::read_to_string(page.path()).map_err(cannot_write(&page.path()))?;
        write_file(&page.path(), with_examples(&text).as_bytes())?;
    }
    for (shell, place) in SHELLS {
        let path = arguments.folder.join(place);
        let folder = path.parent().unwrap_or(&arguments.folder);
        make_folder(Exit::Failed, folder).hint(OWN)?;
        let mut text = Vec::new();
        clap_complete::generate(shell, &mut without_hidden(&described), "onbrick", &mut text);
        write_file(&path, &text)?;
    }
    let folder = &arguments.folder;
    let said = format!("wrote pages and completions into {}", folder.join("share").display());
    output.show(said, &serde_json::json!({ "wrote": folder }));
    Ok(())
}

/// The same, with the synopsis that `--help` has: clap_mangen's own has no `...` where several
/// values are taken.
fn with_usage(mut command: Command) -> Command {
    let usage = command.render_usage().to_string();
    let usage = usage.trim_start_matches("Usage: ").to_owned();
    command.override_usage(usage).mut_subcommands(with_usage)
}

/// A page whose indented lines, the examples, stay as they are: `man` would fill them.
fn with_examples(page: &str) -> String {
    let (mut text, mut inside) = (String::new(), false);
    for line in page.lines() {
        let indented = line.starts_with(' ');
        match (inside, indented) {
            (false, true) => text.push_str(".nf\n"),
            (true, false) => text.push_str(".fi\n"),
            _ => {}
        }
        inside = indented;
        text.push_str(line);
        text.push('\n');
    }
    text
}

/// The same command line as a person sees it: completions would offer hidden commands, too. Of what
/// comes in place of a command's own commands they offer those alone: zsh would take the first word
/// for the one and look for a command in the second.
fn without_hidden(command: &Command) -> Command {
    let has_either = command.is_args_conflicts_with_subcommands_set();
    let arguments = command.get_arguments().filter(|one| !(has_either && one.is_positional()));
    let shown = Command::new(command.get_name().to_owned()).args(arguments.cloned()).subcommands(
        command.get_subcommands().filter(|command| !command.is_hide_set()).map(without_hidden),
    );
    match command.get_about() {
        Some(about) => shown.about(about.clone()),
        None => shown,
    }
}

const OWN: &str = "a folder that you may write to, such as ~/.local";

fn cannot_write(path: &Path) -> impl FnOnce(std::io::Error) -> Failure {
    let doing = format!("cannot write {}", path.display());
    move |error| Failure::from_error(Exit::Failed, &doing, &error).hint(OWN)
}
