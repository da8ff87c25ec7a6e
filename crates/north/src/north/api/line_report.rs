//! What is wrong with lines, drives and the gateway, and the report of a line over a span of time.

use super::ApiText;
use crate::north::titles::PartTitle;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// One thing that was found.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FindingDocument {
    /// How bad it is.
    pub severity: ApiText,
    /// What it is, for programs.
    pub sign: ApiText,
    /// The line that it concerns; `None` for the gateway.
    pub line: Option<String>,
    /// The drive that it concerns.
    pub drive: Option<String>,
    /// What people call that drive or else that line; left out if it has no title.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub title: Option<PartTitle>,
    /// What it is and what to do, in English.
    pub text: ApiText,
    /// The sentence of `text` for a client that shows another language.
    pub said: Value,
}

/// All that is wrong at present.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound(deserialize = "F: Deserialize<'de>"))]
pub struct AdviceDocument<F = FindingDocument> {
    /// The findings, the worst first.
    #[serde(default)]
    pub advice: Vec<F>,
}

/// What happened on a line in a span of time. A number that another version does not send is `None`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LineReportDocument {
    /// The name of the line.
    pub line: ApiText,
    /// `up` or `down`.
    pub state: ApiText,
    /// Why it is down.
    pub reason: Option<String>,
    /// The sentence of `reason` for a client that shows another language.
    pub reason_said: Value,
    /// The port.
    pub port: ApiText,
    /// Speed and characters; `None` over Modbus TCP, which has neither.
    #[serde(default = "unsaid")]
    pub link: Option<ApiText>,
    /// Length of the span in seconds.
    pub observed_s: Option<f64>,
    /// The word for what is suspected of it.
    pub suspicion: Option<String>,
    /// What was found, the worst first.
    pub verdict: Vec<FindingDocument>,
    /// How its exchanges ended.
    pub rates: RatesDocument,
    /// Its drives.
    pub drives: Vec<DriveReportDocument>,
}

fn unsaid() -> Option<ApiText> {
    Some(ApiText::default())
}

/// How the exchanges of a line ended. Shares are of all exchanges, and `None` if there were none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RatesDocument {
    /// All exchanges.
    pub exchanges: Option<u64>,
    /// With an answer.
    pub good_per_mille: Option<f64>,
    /// Without any byte.
    pub silent_per_mille: Option<f64>,
    /// With a damaged reply.
    pub garbled_per_mille: Option<f64>,
    /// Frames that answer nothing.
    pub stray_per_mille: Option<f64>,
    /// Frames of stations that were not asked.
    pub foreign: u64,
    /// Requests of another master.
    pub other_master: u64,
    /// Echoes of our own frames.
    pub echoes: u64,
    /// Bytes that made no frame.
    pub noise_bytes: u64,
    /// How often such bytes arrived while no reply was awaited.
    pub noise_between: u64,
}

/// What happened to one drive of a line. A number that another version does not send is `None`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DriveReportDocument {
    /// Its name.
    pub name: ApiText,
    /// Its station number.
    pub station: Option<u8>,
    /// Whether it answers.
    pub presence: ApiText,
    /// All exchanges.
    pub exchanges: Option<u64>,
    /// Without any byte.
    pub silent: Option<u64>,
    /// With a damaged reply.
    pub damaged: Option<u64>,
    /// Damaged replies of which only the first characters are wrong.
    pub first_characters_damaged: Option<u64>,
    /// Damaged replies whose end is missing.
    pub cut: Option<u64>,
    /// Replies after the time-out.
    pub late: Option<u64>,
    /// Replies later than the declared maximum lateness.
    pub late_beyond_limit: Option<u64>,
    /// Frames that no request explains.
    pub doubled: Option<u64>,
    /// Requests that it refuses.
    pub exceptions: Option<u64>,
    /// Reads that were repeated.
    pub retries: Option<u64>,
    /// The times of its replies, by class of request.
    pub replies: Vec<ReplyTimesDocument>,
}

/// How long a drive takes to reply to one class of requests. A number that another version does not send is `None`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ReplyTimesDocument {
    /// The class.
    pub class: ApiText,
    /// Replies on which this rests.
    pub count: Option<u16>,
    /// Median.
    pub p50_ms: Option<f64>,
    /// 90th percentile.
    pub p90_ms: Option<f64>,
    /// 99th percentile.
    pub p99_ms: Option<f64>,
    /// 99.9th percentile.
    pub p999_ms: Option<f64>,
    /// The longest.
    pub max_ms: Option<f64>,
    /// How long a reply is waited for.
    pub timeout_ms: Option<f64>,
    /// How long it should be waited for; `None` while there are too few replies.
    pub suggested_timeout_ms: Option<f64>,
}
