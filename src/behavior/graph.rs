//! A mission as a picture: the text of a Mermaid `stateDiagram-v2`, which GitHub, GitLab and many
//! editors draw.
//!
//! Each machine is a box, each state a node with its name, each transition an arrow with its
//! condition; the way that blocked wheels lead (`on_stall`) has no condition and is called so.
//! Names and conditions go in as text with every character escaped that Mermaid would
//! take for its own, so that any name can be drawn.

use std::fmt::{self, Write};

use super::mission::{MachinePlan, Mission, RegionPlan};

/// The diagram of a mission.
#[must_use]
pub fn mermaid(mission: &Mission) -> String {
    let mut diagram = String::new();
    // Writing into a string cannot fail.
    let _ = write(mission, &mut diagram);
    diagram
}

fn write(mission: &Mission, out: &mut String) -> fmt::Result {
    writeln!(out, "stateDiagram-v2")?;
    for (index, machine) in mission.machines().iter().enumerate() {
        writeln!(out, "    state \"{}\" as m{index} {{", escaped(&machine.name))?;
        write_region(index, machine, &machine.region, None, "        ", out)?;
        writeln!(out, "    }}")?;
    }
    Ok(())
}

/// The states of a machine, or of the sub-machine inside a state.
fn write_region(
    index: usize,
    machine: &MachinePlan,
    region: &RegionPlan,
    parent: Option<u16>,
    indent: &str,
    out: &mut String,
) -> fmt::Result {
    for (at, state) in machine.inside(parent) {
        // Inside another state the name of that need not be said again.
        let outer = parent.and_then(|parent| machine.state(parent));
        let name = outer.and_then(|outer| state.name.strip_prefix(&outer.name));
        let name = name.and_then(|name| name.strip_prefix('.')).unwrap_or(&state.name);
        write!(out, "{indent}state \"{}\" as m{index}s{at}", escaped(name))?;
        if let Some(inner) = &state.inner {
            writeln!(out, " {{")?;
            write_region(index, machine, inner, Some(at), &format!("{indent}    "), out)?;
            write!(out, "{indent}}}")?;
        }
        writeln!(out)?;
    }
    writeln!(out, "{indent}[*] --> m{index}s{}", region.start)?;
    for (at, state) in machine.inside(parent) {
        for transition in &state.next {
            let when = escaped(transition.when.text());
            writeln!(out, "{indent}m{index}s{at} --> m{index}s{} : {when}", transition.go)?;
        }
    }
    // What holds in all states is drawn once, from a node that stands for them.
    let always = parent.map_or_else(|| "always".to_owned(), |parent| format!("s{parent}always"));
    let ways = region.always.iter().map(|next| (next.go, escaped(next.when.text())));
    let stall = region.on_stall.map(|go| (go, "on_stall".to_owned()));
    for (at, (go, when)) in ways.chain(stall).enumerate() {
        if at == 0 {
            writeln!(out, "{indent}state \"(always)\" as m{index}{always}")?;
        }
        writeln!(out, "{indent}m{index}{always} --> m{index}s{go} : {when}")?;
    }
    match region.end {
        Some(end) => writeln!(out, "{indent}m{index}s{end} --> [*]"),
        None => Ok(()),
    }
}

/// Text with what Mermaid or HTML would take for its own written as Mermaid's entity codes.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        let plain = character.is_alphanumeric() || " _.,+-*/=!()'?".contains(character);
        if plain {
            escaped.push(character);
        } else if character.is_whitespace() {
            escaped.push(' ');
        } else {
            let _ = write!(escaped, "#{};", u32::from(character));
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::super::Capabilities;
    use super::*;

    #[test]
    fn names_and_conditions_that_mermaid_would_misread_are_escaped() {
        let text = "name = \"m\"\n[machine.\"a \\\"b\\\"; c\"]\nstart = \"<x>: {y}\"\n\
            final = \"end\"\n\
            [machine.\"a \\\"b\\\"; c\".state.\"<x>: {y}\"]\n\
            next = [{ when = \"range_m < 1\\nor x_m > 2\", go = \"end\" }]\n\
            [machine.\"a \\\"b\\\"; c\".state.end]\n";
        let (mission, _) = Mission::parse("m.toml", text.as_bytes(), &Capabilities::all()).unwrap();
        let expected = "stateDiagram-v2
    state \"a #34;b#34;#59; c\" as m0 {
        state \"#60;x#62;#58; #123;y#125;\" as m0s0
        state \"end\" as m0s1
        [*] --> m0s0
        m0s0 --> m0s1 : range_m #60; 1 or x_m #62; 2
        m0s1 --> [*]
    }
";
        assert_eq!(mermaid(&mission), expected);
    }

    #[test]
    fn blocked_wheels_lead_out_of_every_state_of_a_machine_and_of_a_sub_machine() {
        let text = "name = \"m\"\non_stall = \"back\"\n[machine.d]\n\
            always = [{ when = \"touch\", go = \"back\" }]\n\
            [machine.d.state.on]\nuse = \"s\"\n\
            [machine.d.state.back]\ndo = { drive_m = -0.1 }\n\
            next = [{ when = \"done\", go = \"on\" }]\n\
            [submachine.s]\non_stall = \"away\"\n\
            [submachine.s.state.away]\ndo = { forward_mps = 0.1 }\n";
        let (mission, _) = Mission::parse("m.toml", text.as_bytes(), &Capabilities::all()).unwrap();
        let drawn = mermaid(&mission);
        let expected = "        state \"(always)\" as m0always
        m0always --> m0s2 : touch
        m0always --> m0s2 : on_stall
";
        assert!(drawn.contains(expected), "{drawn}");
        assert!(drawn.contains("m0s0always --> m0s1 : on_stall"), "{drawn}");
    }
}
