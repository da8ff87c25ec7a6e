//! Where frames of a bus end that arrive without a visible silence between them: requests of the master, each maybe with
//! the reply of another slave.

use super::BROADCAST;
use super::client;
use crate::wire::pdu::function;
use crate::wire::rtu;
use std::ops::Range;

/// Most bytes behind a request that do not cost it: no other frame is as short.
pub(super) const BEHIND_MAX: usize = 3;

/// Unit and PDU of a frame.
type Frame = (u8, Vec<u8>);

/// The frames of which `bytes` consist, in order; `None` if there is anything else. `is_ours` tells the gateway's units,
/// for which no other slave answers.
pub(super) fn all_in(bytes: &[u8], is_ours: &dyn Fn(u8) -> bool) -> Option<Vec<Frame>> {
    let mut frames = Vec::new();
    let mut asked = None;
    let mut rest = bytes;
    while !rest.is_empty() {
        let reply = asked.take().and_then(|asked| reply_to(asked, rest));
        let (frame, adu_bytes) = match reply {
            Some(reply) => reply,
            None => {
                let request = framed(rest, request_adu_bytes(rest)?)?;
                let ((unit, pdu), _) = &request;
                asked = pdu.first().map(|function| (*unit, *function));
                asked = asked.filter(|(unit, _)| *unit != BROADCAST && !is_ours(*unit));
                request
            }
        };
        frames.push(frame);
        rest = rest.get(adu_bytes..)?;
    }
    Some(frames)
}

/// The requests for the gateway's units in `bytes`, in order, with noise or frames of others between them.
pub(super) fn requests_in(
    bytes: &[u8],
    is_ours: &dyn Fn(u8) -> bool,
) -> Vec<(Range<usize>, Frame)> {
    let mut requests = Vec::new();
    let mut start = 0;
    while let Some(rest) = bytes.get(start..)
        && let Some(unit) = rest.first()
    {
        let length = if is_ours(*unit) {
            request_adu_bytes(rest)
        } else {
            None
        };
        match length.and_then(|length| framed(rest, length)) {
            Some((frame, length)) => {
                requests.push((start..start + length, frame));
                start += length;
            }
            None => start += 1,
        }
    }
    requests
}

/// The reply to the function of a unit at the beginning of `bytes`, with its length.
fn reply_to((unit, function): (u8, u8), bytes: &[u8]) -> Option<(Frame, usize)> {
    let answered = *bytes.get(1)?;
    let is_reply = *bytes.first()? == unit && answered & !function::EXCEPTION_BIT == function;
    if is_reply {
        framed(bytes, reply_adu_bytes(bytes)?)
    } else {
        None
    }
}

/// The sound frame in the first `adu_bytes` of `bytes`.
fn framed(bytes: &[u8], adu_bytes: usize) -> Option<(Frame, usize)> {
    let (unit, pdu) = rtu::decode(bytes.get(..adu_bytes)?)?;
    Some(((unit, pdu.to_vec()), adu_bytes))
}

/// Length of the request frame that begins with `adu`, where its function tells.
fn request_adu_bytes(adu: &[u8]) -> Option<usize> {
    let counted = |at: usize| adu.get(at).map(|count| at + 1 + usize::from(*count) + 2);
    match *adu.get(1)? {
        client::READ_COILS
        | client::READ_DISCRETE
        | function::READ_HOLDING
        | function::READ_INPUT
        | client::WRITE_COIL
        | function::WRITE_SINGLE
        | function::DIAGNOSTICS => Some(8),
        client::WRITE_COILS | function::WRITE_MULTIPLE => counted(6),
        client::MASK_WRITE => Some(10),
        client::READ_WRITE => counted(10),
        client::ENCAPSULATED => Some(7),
        _ => None,
    }
}

/// Length in bytes of the reply frame that begins with `adu`, where its function tells.
fn reply_adu_bytes(adu: &[u8]) -> Option<usize> {
    match *adu.get(1)? {
        function if function & function::EXCEPTION_BIT != 0 => Some(5),
        client::READ_COILS
        | client::READ_DISCRETE
        | function::READ_HOLDING
        | function::READ_INPUT
        | client::READ_WRITE => adu.get(2).map(|count| 3 + usize::from(*count) + 2),
        client::WRITE_COIL
        | client::WRITE_COILS
        | function::WRITE_SINGLE
        | function::WRITE_MULTIPLE
        | function::DIAGNOSTICS => Some(8),
        client::MASK_WRITE => Some(10),
        _ => None,
    }
}
