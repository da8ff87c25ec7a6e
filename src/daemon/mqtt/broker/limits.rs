//! The limits of the broker.

/// Retained messages at most. A message for another topic is then delivered, but not kept.
pub const RETAINED_MAX: usize = 100_000;
/// Total size of the retained messages at most, in bytes.
pub const RETAINED_BYTES_MAX: usize = 256 * 1024 * 1024;
/// Longest packet, in bytes. More than the gateway accepts, so that its own limits can be tested.
pub const PACKET_MAX: u32 = 1024 * 1024;
/// Connections at once.
pub const CONNECTIONS_MAX: usize = 1000;
/// Sessions, including those without a connection; the one without for longest is dropped.
pub const SESSIONS_MAX: usize = 2000;
/// Subscriptions of one client.
pub const SUBSCRIPTIONS_MAX: usize = 10_000;
/// Messages that wait for one client.
pub const WAITING_MAX: usize = 10_000;
/// Total size of the messages that wait for one client, in bytes.
pub const WAITING_BYTES_MAX: usize = 64 * 1024 * 1024;
/// Messages that wait for an acknowledgement, to and from one client.
pub const IN_FLIGHT_MAX: u16 = 64;
/// Messages that wait for an acknowledgement from one client with MQTT 3.1.1, which has no way to learn a limit.
pub const INCOMING_MAX: usize = 1000;
/// Longest identifier of a client, in bytes.
pub const CLIENT_IDENTIFIER_MAX: usize = 1024;
