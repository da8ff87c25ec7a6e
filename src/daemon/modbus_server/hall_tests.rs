//! Places and unread answers over real sockets.
