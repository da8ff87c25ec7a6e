//! The HTTP listener: allowed networks, host names, and users.

use super::file::{ConfigFile, HttpFile, HttpUserFile};
use super::host::host_and_port;
use super::listen::{guarded, is_loopback};
pub use super::ready_http::{HashSource, HttpSettings, HttpTls, PageViewers, UserSettings};
use super::words::CommandInterface;
use crate::domain::problem::Problem;
use crate::north::operator::password::StoredHash;
use crate::north::operator::rights::{UserRights, UserRole};
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
    names_are_unique(&http.users, problems);
    viewers_can_sign_in(http, problems);
    setup_has_users(http, problems);
    groups_exist(http, file, problems);
    let hosts = hosts(&http.hosts, problems);
    let users: Vec<_> = http
        .users
        .iter()
        .map(|user| ready_user(user, problems))
        .collect();
    let tls = match &http.tls {
        OptionalKey::Absent => None,
        OptionalKey::Invalid => return None,
        OptionalKey::Valid(tls) => Some(HttpTls {
            cert_file: tls.value.cert_file.as_ref()?.value.clone(),
            key_file: tls.value.key_file.as_ref()?.value.clone(),
        }),
    };
    Some(HttpSettings {
        listen: http.listen.as_ref()?.value,
        allow: http.allow.clone().optional()?,
        hosts: hosts?,
        view: http.view()?,
        setup: http.setup()?,
        users: users.into_iter().collect::<Option<_>>()?,
        tls,
    })
}

/// A password is never sent unencrypted over the network.
fn users_are_protected(http: &HttpFile, problems: &mut Vec<Problem>) {
    let elsewhere = http
        .listen
        .as_ref()
        .filter(|listen| !is_loopback(listen.value.ip()));
    let (Some(listen), false, OptionalKey::Absent) = (elsewhere, http.users.is_empty(), &http.tls)
    else {
        return;
    };
    let what = format!(
        "{} can be reached from other hosts, and passwords would be sent unencrypted",
        listen.value
    );
    let right =
        "`[http.tls]` with `cert_file` and `key_file`, or a loopback address, or no `users`";
    problems.push(http.location.missing("tls").problem(what).right(right));
}

/// Users require a drive that they may command.
fn users_command(http: &HttpFile, file: &ConfigFile, problems: &mut Vec<Problem>) {
    let Some(user) = http.users.first() else {
        return;
    };
    let takes = |control: &OptionalKey<super::file::ControlFile>| match control {
        OptionalKey::Absent => false,
        OptionalKey::Invalid => true,
        OptionalKey::Valid(control) => {
            control.value.from.is_none() || control.value.names(CommandInterface::Page).is_some()
        }
    };
    // Where one has to sign in to look or sets up in the page, a user has an effect without any control.
    let is_private =
        matches!(&http.view, OptionalKey::Valid(view) if view.value == PageViewers::SignedIn);
    if !is_private
        && !http.sets_up()
        && !file
            .lines
            .iter()
            .flat_map(|line| &line.drives)
            .any(|drive| takes(&drive.control))
    {
        let problem = user
            .location
            .problem("has no effect: no drive takes commands from \"page\"");
        let right = "`from = [\"page\"]` in the `[line.drive.control]` of a drive, or no `users`";
        problems.push(problem.right(right).warning());
    }
    if let Some(user) = http.users.get(USERS_MAX) {
        problems.push(
            user.location
                .problem("there are too many users")
                .right(format!("at most {USERS_MAX}")),
        );
    }
}

/// Where viewing requires a sign-in, there must be a user.
fn viewers_can_sign_in(http: &HttpFile, problems: &mut Vec<Problem>) {
    let OptionalKey::Valid(view) = &http.view else {
        return;
    };
    if view.value == PageViewers::SignedIn && http.users.is_empty() {
        let problem = view
            .location
            .problem("no one can sign in: there are no `users`");
        problems.push(problem.right(
            "a `[[http.users]]`, with `role = \"view\"` for one who only looks, or \"anyone\"",
        ));
    }
}

/// Set-up in the page and the role for it belong together.
fn setup_has_users(http: &HttpFile, problems: &mut Vec<Problem>) {
    let setup = http.setup.valid().filter(|written| written.value);
    let user = http.users.iter().find_map(|user| {
        user.role
            .valid()
            .filter(|role| role.value == UserRole::Setup)
    });
    match (setup, user) {
        (Some(setup), None) => {
            let problem = setup
                .location
                .problem("no user may set up: none has the role `setup`");
            problems.push(problem.right("`role = \"setup\"` in a `[[http.users]]`, or no `setup`"));
        }
        (None, Some(role)) => {
            let problem = role
                .location
                .problem("is no more than \"maintain\": set-up in the page is off");
            problems.push(
                problem
                    .right("`setup = true` in [http], or \"maintain\"")
                    .warning(),
            );
        }
        _ => (),
    }
}

/// A group without a drive is a misspelt one.
fn groups_exist(http: &HttpFile, file: &ConfigFile, problems: &mut Vec<Problem>) {
    let drives = || file.lines.iter().flat_map(|line| &line.drives);
    let known: BTreeSet<_> = drives()
        .filter_map(|drive| drive.group.clone().optional().flatten())
        .collect();
    for user in &http.users {
        let OptionalKey::Valid(groups) = &user.groups else {
            continue;
        };
        for group in groups
            .value
            .iter()
            .filter(|group| !known.contains(&group.value))
        {
            let problem = group
                .location
                .problem(format!("no drive is in the group `{}`", group.value));
            let list: Vec<_> = known.iter().map(|name| format!("\"{name}\"")).collect();
            let right = if list.is_empty() {
                "`group` in a `[[line.drive]]`".to_owned()
            } else {
                list.join(", ")
            };
            problems.push(problem.right(right));
        }
    }
}

fn names_are_unique(users: &[HttpUserFile], problems: &mut Vec<Problem>) {
    let names: Vec<_> = users.iter().filter_map(|user| user.name.as_ref()).collect();
    for (index, name) in names.iter().enumerate() {
        if let Some(first) = names
            .iter()
            .take(index)
            .find(|earlier| earlier.value == name.value)
        {
            let what = format!(
                "the name `{}` is taken by {}",
                name.value, first.location.key
            );
            problems.push(
                name.location
                    .problem(what)
                    .right("a name that no other user uses"),
            );
        }
    }
}

/// The names in lower case, for comparison.
fn hosts(
    given: &OptionalKey<Vec<LocatedValue<String>>>,
    problems: &mut Vec<Problem>,
) -> Option<Vec<String>> {
    let list = match given {
        OptionalKey::Absent => return Some(Vec::new()),
        OptionalKey::Invalid => return None,
        OptionalKey::Valid(list) => &list.value,
    };
    let host = |written: &LocatedValue<String>| match host_and_port(&written.value) {
        Some((host, None)) => Some(host.to_ascii_lowercase()),
        _ => {
            let problem = written
                .location
                .problem(format!("`{}` is not a host name", written.value));
            problems.push(problem.right("a name without a port, as \"gateway.plant.example\""));
            None
        }
    };
    list.iter()
        .map(host)
        .collect::<Vec<_>>()
        .into_iter()
        .collect()
}

fn ready_user(user: &HttpUserFile, problems: &mut Vec<Problem>) -> Option<UserSettings> {
    let hash = match (&user.password_hash, &user.password_hash_file) {
        (OptionalKey::Valid(text), OptionalKey::Absent) => {
            read_hash(text, problems).map(HashSource::Text)
        }
        (OptionalKey::Absent, OptionalKey::Valid(file)) => {
            Some(HashSource::File(file.value.clone()))
        }
        (OptionalKey::Absent, OptionalKey::Absent) => {
            one_is_needed(
                &user.location.missing("password_hash_file"),
                "the user has no password",
                problems,
            );
            None
        }
        (OptionalKey::Valid(_), OptionalKey::Valid(file)) => {
            one_is_needed(
                &file.location,
                "the user has a `password_hash` already",
                problems,
            );
            None
        }
        _ => None,
    };
    let groups = match &user.groups {
        OptionalKey::Absent => None,
        OptionalKey::Invalid => return None,
        OptionalKey::Valid(groups) => Some(
            groups
                .value
                .iter()
                .map(|group| group.value.clone())
                .collect(),
        ),
    };
    let rights = UserRights {
        role: user.role()?,
        groups,
    };
    Some(UserSettings {
        name: user.name.as_ref()?.value,
        hash: hash?,
        rights,
    })
}

fn one_is_needed(location: &KeyLocation, what: &str, problems: &mut Vec<Problem>) {
    let right = "`password_hash_file` with the file that holds what `vfd-gateway password` prints, or `password_hash` with that itself";
    problems.push(location.problem(what).right(right));
}

fn read_hash(text: &LocatedValue<String>, problems: &mut Vec<Problem>) -> Option<StoredHash> {
    // An invalid hash may be a password, which must not appear in messages.
    let unfit = |why| {
        text.location
            .problem(format!("the text {why}"))
            .right("what `vfd-gateway password` prints")
    };
    StoredHash::parse(&text.value)
        .map_err(|why| problems.push(unfit(why)))
        .ok()
}
