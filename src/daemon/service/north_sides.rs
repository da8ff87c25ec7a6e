//! The north sides that lines answer to.

use crate::daemon::exchange::answers::AnswerBox;
use crate::daemon::journal::Journal;
use std::sync::Arc;

/// The north sides that lines answer to, and where both keep what is to be kept.
#[derive(Clone, Debug, Default)]
pub struct NorthSides {
    /// Modbus TCP connections.
    pub modbus: Arc<AnswerBox>,
    /// MQTT; nothing if there is none, and then nobody keeps news for it.
    pub mqtt: Option<Arc<AnswerBox>>,
    /// Sparkplug, in the same way.
    pub sparkplug: Option<Arc<AnswerBox>>,
    /// The program's own tools, and the page.
    pub local: Arc<AnswerBox>,
    /// The journal; nothing if there is no data directory.
    pub journal: Option<Arc<Journal>>,
}
