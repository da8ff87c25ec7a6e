//! Operators on the page: passwords, sign-in and its rate limit, sessions, what a request must carry, how old an order
//! may be. Time and random numbers are arguments.

pub mod attempts;
pub mod body;
pub mod moments;
pub mod password;
pub mod request;
pub mod rights;
pub mod sessions;
