//! From bytes to a request, or to a refusal that says what is wrong with them.

use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::{
    Asked, Id, Kind, LocalOnly, LocalRequest, MAX_REQUEST_BYTES, Refusal, Request, VERSION,
};
use crate::printable::{self, Layout, shown};

/// A request that was not understood, with its client's name for it where that could be read.
#[derive(Debug, Clone, PartialEq)]
pub struct NotUnderstood {
    /// The request's, where it could be read.
    pub id: Option<Id>,
    /// What is wrong.
    pub refusal: Refusal,
}

impl From<Refusal> for NotUnderstood {
    fn from(refusal: Refusal) -> Self {
        Self { id: None, refusal }
    }
}

/// Operations of [`Request`].
const SHARED: [&str; 8] =
    ["status", "missions", "start", "stop", "runs", "fetch", "identify", "live"];

/// Operations of [`LocalOnly`].
const OWN: [&str; 12] = [
    "jog",
    "delete",
    "start_here",
    "menu_here",
    "starter_here",
    "menu_closed",
    "acknowledge",
    "pairing_window",
    "pairing_state",
    "pairing_answer",
    "settings",
    "set_settings",
];

/// What every request has. A key that is there twice is refused, because two readers could each
/// believe another one.
#[derive(Deserialize)]
struct Envelope {
    id: Id,
    version: u32,
    op: String,
}

/// Longer names of requests would only fill the replies.
const MAX_ID_BYTES: usize = 64;

/// Reads a request that came over the network.
///
/// # Errors
///
/// [`NotUnderstood`], to be sent back.
pub fn parse(bytes: &[u8]) -> Result<Asked<Request>, NotUnderstood> {
    let envelope = envelope(bytes, &[&SHARED])?;
    let request = body(bytes, &envelope.id)?;
    Ok(Asked { id: envelope.id, request })
}

/// Reads a request that came over the local socket.
///
/// # Errors
///
/// [`NotUnderstood`], to be sent back.
pub fn parse_local(bytes: &[u8]) -> Result<Asked<LocalRequest>, NotUnderstood> {
    let envelope = envelope(bytes, &[&SHARED, &OWN])?;
    let request = if OWN.contains(&envelope.op.as_str()) {
        LocalRequest::Own(body::<LocalOnly>(bytes, &envelope.id)?)
    } else {
        LocalRequest::Shared(body::<Request>(bytes, &envelope.id)?)
    };
    Ok(Asked { id: envelope.id, request })
}

fn envelope(bytes: &[u8], known: &[&[&str]]) -> Result<Envelope, NotUnderstood> {
    if bytes.len() > MAX_REQUEST_BYTES {
        let message =
            format!("the request has {} bytes, and {MAX_REQUEST_BYTES} are the most", bytes.len());
        return Err(Refusal::bad_request(message).into());
    }
    if bytes.trim_ascii_start().first() != Some(&b'{') {
        return Err(Refusal::bad_request("not a request: it is no object in JSON").into());
    }
    let envelope: Envelope = serde_json::from_slice(bytes).map_err(|error| {
        // A request that can be read at all is answered under its own name.
        let message = format!("not a request: {}", said::<Envelope>(bytes, &error));
        NotUnderstood { id: id_of(bytes), refusal: Refusal::bad_request(message) }
    })?;
    if matches!(&envelope.id, Id::Text(text) if text.len() > MAX_ID_BYTES) {
        let message = format!("an id has at most {MAX_ID_BYTES} bytes");
        return Err(Refusal::bad_request(message).into());
    }
    if envelope.version != VERSION {
        let refusal = Refusal::of_version(envelope.version);
        return Err(NotUnderstood { id: Some(envelope.id), refusal });
    }
    if !known.iter().any(|names| names.contains(&envelope.op.as_str())) {
        let op = printable::name(&envelope.op);
        let names = known.concat().join(", ");
        let message = format!("there is no operation `{op}`; there are {names}");
        let refusal = Refusal::new(Kind::UnknownOperation, message);
        return Err(NotUnderstood { id: Some(envelope.id), refusal });
    }
    Ok(envelope)
}

fn id_of(bytes: &[u8]) -> Option<Id> {
    let value: Value = serde_json::from_slice(bytes).ok()?;
    let id: Id = serde_json::from_value(value.get("id")?.clone()).ok()?;
    match &id {
        Id::Text(text) if text.len() > MAX_ID_BYTES => None,
        _ => Some(id),
    }
}

fn body<R: DeserializeOwned>(bytes: &[u8], id: &Id) -> Result<R, NotUnderstood> {
    serde_json::from_slice(bytes).map_err(|error| NotUnderstood {
        id: Some(id.clone()),
        refusal: Refusal::bad_request(format!(
            "the request's fields: {}",
            said::<R>(bytes, &error)
        )),
    })
}

/// What is wrong with which field, where one is of a wrong type. Of a type with a tag, serde does
/// not tell which: it is the one without which the error is another one, or none.
fn wrong_field<R: DeserializeOwned>(bytes: &[u8]) -> Option<String> {
    // Of operations; a request may have any number of others.
    const MOST_FIELDS: usize = 16;
    let mut request: Value = serde_json::from_slice(bytes).ok()?;
    let error = |request: &Value| R::deserialize(request).err().map(|error| error.to_string());
    // Which field is missing, it says itself.
    let whole = error(&request).filter(|whole| !whole.starts_with("missing field"))?;
    let mut fields: Vec<String> = request.as_object()?.keys().take(MOST_FIELDS).cloned().collect();
    // Without the tag any error is another one.
    fields.sort_by_key(|field| field == "op");
    let wrong = fields.iter().find(|field| {
        let taken = request.as_object_mut().and_then(|fields| fields.remove(*field));
        let is_it = error(&request).as_ref() != Some(&whole);
        if let Some((fields, taken)) = request.as_object_mut().zip(taken) {
            fields.insert((*field).clone(), taken);
        }
        is_it
    })?;
    Some(format!("`{}`: {whole}", printable::name(wrong)))
}

/// What was not understood is repeated in it, however long it is: of a long text the middle is left
/// out.
fn said<R: DeserializeOwned>(bytes: &[u8], error: &serde_json::Error) -> String {
    const BEGINNING: usize = 200;
    const END: usize = 100;
    let text = wrong_field::<R>(bytes).unwrap_or_else(|| error.to_string());
    let text = shown(&text, Layout::Line, usize::MAX);
    let count = text.chars().count();
    if count <= BEGINNING + END {
        return text.into_owned();
    }
    let beginning: String = text.chars().take(BEGINNING).collect();
    let end: String = text.chars().skip(count - END).collect();
    format!("{beginning}…{end}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::{Chosen, Outcome, Reply, RunId};

    fn refused(text: &[u8]) -> NotUnderstood {
        parse(text).unwrap_err()
    }

    #[test]
    fn a_request_in_json_is_a_request() {
        let asked =
            parse(br#"{"version":1,"id":"a","op":"start","run":"r-1","mission":{"name":"map"},"later":[1]}"#);
        let asked = asked.unwrap();
        assert_eq!(asked.id, Id::Text("a".to_owned()));
        let Request::Start(start) = asked.request else { panic!("{:?}", asked.request) };
        assert_eq!((start.run.as_str(), start.mission), ("r-1", Chosen::Name("map".to_owned())));
        assert_eq!(
            parse(br#"{"version":1,"id":3,"op":"stop"}"#).unwrap().request,
            Request::Stop { run: None }
        );
    }

    #[test]
    fn what_is_no_object_is_no_request() {
        // Serde would take a list for the fields of an envelope in their order.
        for text in [&b"[3, 1, \"status\"]"[..], b"status", b"\"status\"", b"", b" "] {
            let refused = refused(text);
            assert_eq!((refused.id, refused.refusal.kind), (None, Kind::BadRequest));
            assert_eq!(refused.refusal.message, "not a request: it is no object in JSON");
        }
        assert!(parse(b"\n {\"version\":1,\"id\":3,\"op\":\"status\"}").is_ok());
    }

    #[test]
    fn every_named_operation_is_one() {
        for op in SHARED.into_iter().chain(OWN) {
            let text = format!(r#"{{"version":1,"id":1,"op":"{op}"}}"#);
            let kind =
                parse_local(text.as_bytes()).map(|_| ()).map_err(|error| error.refusal.message);
            // Those with fields say which is missing; none is unknown.
            if let Err(message) = kind {
                assert!(message.contains("missing field"), "{op}: {message}");
            }
        }
    }

    #[test]
    fn what_is_not_understood_says_why_under_its_own_name() {
        let unknown = refused(br#"{"version":1,"id":9,"op":"jog","port":"outA","percent":100}"#);
        assert_eq!(
            (unknown.id, unknown.refusal.kind),
            (Some(Id::Number(9)), Kind::UnknownOperation)
        );
        assert!(
            unknown.refusal.message.contains("status, missions, start"),
            "{}",
            unknown.refusal.message
        );
        let forged =
            refused(b"{\"version\":1,\"id\":9,\"op\":\"a\\nb\\u001b[2J\"}").refusal.message;
        assert!(forged.contains(r"`a\nb\u{1b}[2J`") && !forged.contains('\n'), "{forged}");
        let forged = refused(
            b"{\"version\":1,\"id\":9,\"op\":\"start\",\"run\":\"r\",\"mission\":{\"a\\nb\":1}}",
        );
        assert!(!forged.refusal.message.contains('\n'), "{}", forged.refusal.message);
        let version = refused(br#"{"version":2,"id":9,"op":"status"}"#);
        assert_eq!((version.id, version.refusal.kind), (Some(Id::Number(9)), Kind::Version));
        assert!(version.refusal.message.starts_with("the onbrick that was asked is older"));
        for bad in [
            &b"\xff\xfe"[..],
            b"",
            b"[]",
            br#"{"id":1,"version":1}"#,
            br#"{"id":1,"id":2,"version":1,"op":"status"}"#,
            br#"{"id":1,"version":1,"op":"stop","run":"../../etc/passwd"}"#,
            br#"{"id":1,"version":1,"op":"fetch","run":"r","offset":-1,"length":1}"#,
            br#"{"id":1,"version":1,"op":"stop","run":"a","run":"b"}"#,
        ] {
            assert_eq!(
                refused(bad).refusal.kind,
                Kind::BadRequest,
                "{}",
                String::from_utf8_lossy(bad)
            );
        }
        let deep = format!(r#"{{"id":1,"version":1,"op":"status","x":{}"#, "[".repeat(100_000));
        assert_eq!(refused(deep.as_bytes()).refusal.kind, Kind::BadRequest);
    }

    #[test]
    fn a_refusal_is_short_and_says_what_is_wrong_however_long_the_request_is() {
        let long = "9ä".repeat(10_000);
        for (text, what) in [
            (format!(r#"{{"id":1,"op":"status","version":"{long}"}}"#), "`version`: invalid type"),
            (format!(r#"{{"id":1,"op":"status","version":"{long}"}}"#), "expected u32"),
            (
                format!(
                    r#"{{"id":1,"version":1,"op":"fetch","run":"r","offset":"{long}","length":1}}"#
                ),
                "expected u64",
            ),
        ] {
            let message = refused(text.as_bytes()).refusal.message;
            assert!(message.len() < 1000 && message.contains(what), "{message}");
        }
    }

    #[test]
    fn a_field_of_a_wrong_type_is_named() {
        for (fields, message) in [
            (r#""op":"fetch","run":"r","offset":-1,"length":1"#, "`offset`: invalid value"),
            (r#""op":"fetch","run":"r","offset":"x","length":[]"#, "`length`: invalid type"),
            (r#""op":"start","run":7,"mission":{"name":"map"}"#, "`run`: invalid type"),
            (r#""op":"start","run":"r","mission":{"name":7}"#, "`mission`: "),
            (r#""op":"stop","run":"../x","later":[1]"#, "`run`: a run's identifier has"),
            (r#""op":"fetch","run":"r","length":1"#, "fields: missing field `offset`"),
            (r#""op":"stop","run":"a","run":"b""#, "fields: duplicate field `run`"),
            (r#""op":7"#, "not a request: `op`: invalid type"),
        ] {
            let text = format!(r#"{{"id":1,"version":1,{fields}}}"#);
            let said = refused(text.as_bytes()).refusal.message;
            assert!(said.contains(message), "{text}: {said}");
        }
    }

    #[test]
    fn a_reply_has_the_outcome_beside_its_id() {
        let reply = Reply {
            id: Some(Id::Number(7)),
            outcome: Outcome::Ok(serde_json::json!({"run": "r"})),
        };
        assert_eq!(serde_json::to_string(&reply).unwrap(), r#"{"id":7,"ok":{"run":"r"}}"#);
        let text = r#"{"id":7,"error":{"kind":"from_the_future","message":"m","hint":null}}"#;
        let reply: Reply = serde_json::from_str(text).unwrap();
        assert_eq!(reply.outcome, Outcome::Error(Refusal::new(Kind::Other, "m")));
    }

    #[test]
    fn identifiers_are_names_of_folders_and_nothing_else() {
        for bad in ["", ".", "..", "a/b", "a b", "ä", &"x".repeat(41)] {
            assert!(RunId::new(bad).is_err(), "{bad}");
        }
        assert_eq!(RunId::new("map-1_X").unwrap().as_str(), "map-1_X");
        for (mission, name) in
            [("four walls", "four-walls-7f-1"), ("zähle", "z-hle-7f-1"), ("", "-7f-1")]
        {
            assert_eq!(RunId::of_mission(mission, "7f-1").unwrap().as_str(), name);
        }
        let long = RunId::of_mission(&"x".repeat(200), "7f-1").unwrap();
        assert_eq!(long.as_str(), format!("{}-7f-1", "x".repeat(RunId::MAX_BYTES - 5)));
    }

    proptest::proptest! {
        #[test]
        fn any_bytes_are_a_request_or_a_refusal(bytes: Vec<u8>) {
            let _ = parse_local(&bytes);
        }
    }
}
