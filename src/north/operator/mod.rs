//! Those who command from the page: passwords, sign-in with its rate, sessions, what a request must bring, how old an order may
//! be. Time and random numbers are arguments.

pub mod attempts;
pub mod body;
pub mod moments;
pub mod password;
pub mod request;
pub mod sessions;
