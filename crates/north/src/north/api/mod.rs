//! The documents that the gateway serves to its own tools, and the bodies that they send, as types for both sides.
//!
//! A document is read by tools that are a version older or newer: unknown keys are ignored, and what is missing or of
//! another type has a default. A body is read exactly: unknown and repeated keys are refused, and missing ones unless they
//! are optional.

mod bodies;
mod health;
mod line_report;
mod order_outcome;
mod parameters;
mod passed_on;
mod plant;
mod refusal;
mod reload;
mod setup;
mod text;
mod tolerant;
mod traffic;
mod trials;

pub use bodies::{
    AddressesBody, EmptyBody, FindingBody, HandOverBody, NumberBody, PersonBody, SignInBody,
    TrialBody, WatchdogBody, read_exactly,
};
pub use health::{
    BrokerHealthDocument, DriveHealthDocument, HealthDocument, HostHealthDocument,
    JournalHealthDocument, LineHealthDocument, OversizedDocument, ReadinessDocument,
    RefusedRegisterDocument, SocketHealthDocument,
};
pub use line_report::{
    AdviceDocument, DriveReportDocument, FindingDocument, LineReportDocument, RatesDocument,
    ReplyTimesDocument,
};
pub use order_outcome::{ChangeDocument, OrderOutcomeDocument};
pub use parameters::{
    CommitDocument, LeftOutDocument, ListedParameterDocument, ParameterDocument,
    ParameterGroupDocument, ParameterListDocument,
};
pub use passed_on::PassedOn;
pub use plant::{
    DayDocument, DaysDocument, FailSafeDocument, LastSeenDocument, StandbyDocument, UsageDocument,
    UsageResetDocument,
};
pub use refusal::{ErrorDocument, UnknownLineDocument};
pub use reload::{
    ConfigurationChange, ConfigurationWarning, HandOverDocument, LineHandOver, RefusedReload,
    ReloadDocument,
};
pub use setup::{
    IdentityDocument, SeenWord, SetupDocument, SetupItemDocument, SetupWatchdogDocument,
    WordDocument,
};
pub use text::ApiText;
pub use tolerant::read_tolerantly;
pub use traffic::{
    FrameDocument, FrameValueDocument, LostRecords, TrafficDriveDocument, TrafficLineDocument,
};
pub use trials::{TrialActionDocument, TrialDocument, TrialFrame, TrialStateDocument, TrialWord};
