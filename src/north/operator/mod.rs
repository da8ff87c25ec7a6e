//! Those who command from the page: passwords, sign-in with its rate, sessions, and what a request must bring. Time and
//! random numbers are arguments.

pub mod attempts;
pub mod body;
pub mod password;
pub mod request;
pub mod sessions;
