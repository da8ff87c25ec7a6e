//! The journal on a real disk: kept, found again, moved aside.
