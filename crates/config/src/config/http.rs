//! The HTTP listener: allowed networks, host names, and users.

use super::file::{ConfigFile, ControlFile, HttpFile, HttpTlsFile, HttpUserFile, ListKey};
use super::host::host_and_port;
use super::listen::{guarded, is_loopback};
use super::lists;
use super::ready::{HashSource, HttpSettings, PageViewers, UserSettings};
use super::words::CommandInterface;
use crate::domain::problem::Problem;
use crate::north::operator::password::StoredHash;
use crate::north::operator::rights::UserRole;
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey};
use std::collections::BTreeSet;

/// Maximum number of users. A person has one name, and a gateway has few operators.
const USERS_MAX: usize = 64;

/// The ready settings of `http` in `file`; `None` if it is invalid, see `problems`.
pub(super) fn settle(
    http: &HttpFile,
    file: &ConfigFile,
    problems: &mut Vec<Problem>,
) -> Option<HttpSettings> {
    guarded(&http.listen, &http.allow, &http.location, problems);
    users_are_protected(http, problems);
    users_command(http, file, problems);
    let names = http.users.iter().filter_map(|user| user.name.as_ref());
    lists::names_differ(names, "user", problems);
    viewers_can_sign_in(http, problems);
    setup_has_users(http, problems);
    groups_exist(http, file, problems);
    let hosts = hosts(&http.hosts, problems);
    let mut users = Vec::new();
    for user in &http.users {
        users.push(ready_user(user, problems));
    }
    let tls = http.tls.settle(HttpTlsFile::settings)?;
    http.settings(hosts?, users.into_iter().collect::<Option<_>>()?, tls)
}

/// A password is never sent unencrypted over the network.
fn users_are_protected(http: &HttpFile, problems: &mut Vec<Problem>) {
    let Some(listen) = &http.listen else { return };
    if is_loopback(listen.value.ip()) || http.users.is_empty() || !http.tls.is_absent() {
        return;
    }
    let what = format!(
        "{} can be reached from other hosts, and passwords would be sent unencrypted",
        listen.value
    );
    let right =
        "`[http.tls]` with `cert_file` and `key_file`, or a loopback address, or no `users`";
    http.location.missing("tls").refuse(what, right, problems);
}

/// Users require a drive that they may command.
fn users_command(http: &HttpFile, file: &ConfigFile, problems: &mut Vec<Problem>) {
    let Some(user) = http.users.first() else {
        return;
    };
    let takes = |control: &OptionalKey<ControlFile>| match control {
        OptionalKey::Absent => false,
        OptionalKey::Invalid => true,
        OptionalKey::Valid(control) => {
            control.value.from.is_none() || control.value.names(CommandInterface::Page).is_some()
        }
    };
    // Where one has to sign in to look or sets up in the page, a user has an effect without any control.
    let is_private = http.view.valid_as(&PageViewers::SignedIn).is_some();
    if !is_private && !http.sets_up() && !file.drives().any(|drive| takes(&drive.control)) {
        let what = "has no effect: no drive takes commands from \"page\"";
        let right = "`from = [\"page\"]` in the `[line.drive.control]` of a drive, or no `users`";
        user.location.warn(what, right, problems);
    }
    if let Some(user) = http.users.get(USERS_MAX) {
        let right = format!("at most {USERS_MAX}");
        user.location
            .refuse("there are too many users", right, problems);
    }
}

/// Where viewing requires a sign-in, there must be a user.
fn viewers_can_sign_in(http: &HttpFile, problems: &mut Vec<Problem>) {
    if let Some(view) = http.view.valid_as(&PageViewers::SignedIn)
        && http.users.is_empty()
    {
        let right =
            "a `[[http.users]]`, with `role = \"view\"` for one who only looks, or \"anyone\"";
        view.refuse("no one can sign in: there are no `users`", right, problems);
    }
}

/// Set-up in the page and the role for it belong together.
fn setup_has_users(http: &HttpFile, problems: &mut Vec<Problem>) {
    let setup = http.setup.valid_as(&true);
    let mut users = http.users.iter();
    let role = users.find_map(|user| user.role.valid_as(&UserRole::Setup));
    match (setup, role) {
        (Some(setup), None) => {
            let what = "no user may set up: none has the role `setup`";
            let right = "`role = \"setup\"` in a `[[http.users]]`, or no `setup`";
            setup.refuse(what, right, problems);
        }
        (None, Some(role)) => {
            let what = "is no more than \"maintain\": set-up in the page is off";
            role.warn(what, "`setup = true` in [http], or \"maintain\"", problems);
        }
        _ => (),
    }
}

/// A group without a drive is a misspelt one.
fn groups_exist(http: &HttpFile, file: &ConfigFile, problems: &mut Vec<Problem>) {
    let groups = file.drives().filter_map(|drive| drive.group.valid());
    let known: BTreeSet<_> = groups.map(|group| &group.value).collect();
    let listed = http.users.iter().filter_map(|user| user.groups.valid());
    for group in listed.flat_map(|groups| &groups.value) {
        if known.contains(&group.value) {
            continue;
        }
        let list: Vec<_> = known.iter().map(|name| format!("\"{name}\"")).collect();
        let right = match list.is_empty() {
            true => "`group` in a `[[line.drive]]`".to_owned(),
            false => list.join(", "),
        };
        let what = format!("no drive is in the group `{}`", group.value);
        group.refuse(what, right, problems);
    }
}

/// The names in lower case, for comparison.
fn hosts(given: &ListKey<String>, problems: &mut Vec<Problem>) -> Option<Vec<String>> {
    let host = |written: &LocatedValue<String>| {
        if let Some((host, None)) = host_and_port(&written.value) {
            return Some(host.to_ascii_lowercase());
        }
        let what = format!("`{}` is not a host name", written.value);
        let right = "a name without a port, as \"gateway.plant.example\"";
        written.refuse(what, right, problems);
        None
    };
    let hosts = given.settle(|list| {
        let hosts: Vec<_> = list.iter().map(host).collect();
        hosts.into_iter().collect()
    })?;
    Some(hosts.unwrap_or_default())
}

fn ready_user(user: &HttpUserFile, problems: &mut Vec<Problem>) -> Option<UserSettings> {
    let hash = match (&user.password_hash, &user.password_hash_file) {
        (OptionalKey::Valid(text), OptionalKey::Absent) => {
            HashSource::Text(read_hash(text, problems)?)
        }
        (OptionalKey::Absent, OptionalKey::Valid(file)) => HashSource::File(file.value.clone()),
        (OptionalKey::Absent, OptionalKey::Absent) => {
            let location = user.location.missing("password_hash_file");
            one_is_needed(&location, "the user has no password", problems);
            return None;
        }
        (OptionalKey::Valid(_), OptionalKey::Valid(file)) => {
            let what = "the user has a `password_hash` already";
            one_is_needed(&file.location, what, problems);
            return None;
        }
        _ => return None,
    };
    user.settings(hash)
}

fn one_is_needed(location: &KeyLocation, what: &str, problems: &mut Vec<Problem>) {
    let right = "`password_hash_file` with the file that holds what `vfd-gateway password` prints, or `password_hash` with that itself";
    location.refuse(what, right, problems);
}

fn read_hash(text: &LocatedValue<String>, problems: &mut Vec<Problem>) -> Option<StoredHash> {
    match StoredHash::parse(&text.value) {
        Ok(hash) => Some(hash),
        // An invalid hash may be a password, which must not appear in messages.
        Err(why) => {
            let right = "what `vfd-gateway password` prints";
            text.refuse(format!("the text {why}"), right, problems);
            None
        }
    }
}
