//! Requests and replies without station and check: what decodes encodes back, and only a matching reply is accepted.
//!
//! Input: a piece that is the request's PDU, then the reply's.

use super::feed::Feed;
use vfd_model::domain::address::DataTable;
use vfd_model::wire::exception;
use vfd_model::wire::mbap;
use vfd_model::wire::pdu::{MAX_PDU_BYTES, Reply, Request, encode_read_reply, function};
use vfd_north::north::modbus::{ModbusRequest, parse};

pub fn run(bytes: &[u8]) {
    let mut feed = Feed::new(bytes);
    let request = feed.piece();
    let reply = feed.rest();
    header(bytes);
    if request.len() <= MAX_PDU_BYTES {
        of_a_client(request);
    }
    let unserved = request.first().map(|function| Request::Unserved {
        function: function & 0x7F,
        data: 0xA537,
    });
    for request in Request::decode(request)
        .into_iter()
        .inspect(|it| formats_back(it, request))
        .chain(unserved)
    {
        if let Some(answer) = request.reply_in(reply) {
            is_the_right_one(&request, &answer, reply);
        }
        (0..=u8::MAX).for_each(|code| {
            assert!(request.is_answered_by(code) || request.reply_pdu_bytes() == 2)
        });
    }
}

fn encoded(request: &Request) -> Vec<u8> {
    let mut pdu = Vec::new();
    request.encode(&mut pdu);
    pdu
}

fn formats_back(request: &Request, pdu: &[u8]) {
    assert_eq!(encoded(request), pdu);
    assert_eq!(Request::decode(pdu).as_ref(), Some(request));
}

fn is_the_right_one(request: &Request, answer: &Reply, pdu: &[u8]) {
    assert_eq!(
        (pdu.len(), pdu[0]),
        (request.reply_pdu_bytes(), request.function())
    );
    let asked = encoded(request);
    match (request, answer) {
        (Request::Read { count, .. }, Reply::Words(words)) => {
            assert_eq!(words.len(), usize::from(*count));
            let mut again = Vec::new();
            encode_read_reply(&mut again, DataTable::Holding, words);
            assert_eq!(again, pdu);
        }
        (Request::WriteSingle { .. }, Reply::Holds { value }) => {
            assert_eq!(pdu[..3], asked[..3], "another register");
            assert_eq!(pdu[3..], value.to_be_bytes());
        }
        (Request::Loopback { .. } | Request::WriteMultiple { .. }, Reply::Echo) => {
            assert_eq!(pdu[..5], asked[..5])
        }
        other => panic!("{other:?}"),
    }
}

/// A client's request is decoded exactly, or refused with an exception that says why.
fn of_a_client(pdu: &[u8]) {
    match parse(pdu) {
        Err(code) => assert!(
            [
                exception::ILLEGAL_FUNCTION,
                exception::ILLEGAL_DATA_ADDRESS,
                exception::ILLEGAL_DATA_VALUE
            ]
            .contains(&code),
            "exception {code}"
        ),
        Ok(ask) => {
            assert_eq!(ask.function(), pdu[0]);
            let same = match ask {
                ModbusRequest::ReadWords { address, count, .. }
                    if pdu[0] == function::READ_HOLDING =>
                {
                    Request::Read {
                        address: address.into(),
                        count,
                    }
                }
                ModbusRequest::LoopTest { data } => Request::Loopback { data },
                ModbusRequest::WriteWord { address, value } => Request::WriteSingle {
                    address: address.into(),
                    value,
                },
                ModbusRequest::WriteWords { address, values } => {
                    assert!(
                        usize::from(address) + values.len() <= 0x1_0000,
                        "past the last register"
                    );
                    Request::WriteMultiple {
                        address: address.into(),
                        values,
                    }
                }
                _ => return,
            };
            assert_eq!(encoded(&same), pdu);
        }
    }
}

/// The header of a Modbus TCP message matches the bytes of `stream`.
fn header(stream: &[u8]) {
    let Ok(Some(message)) = mbap::decode(stream) else {
        return;
    };
    assert!((1..=MAX_PDU_BYTES).contains(&message.pdu.len()));
    let mut again = Vec::new();
    mbap::encode(&mut again, message.transaction, message.unit, |out| {
        out.extend_from_slice(message.pdu)
    });
    assert_eq!(again, stream[..message.adu_bytes]);
}
