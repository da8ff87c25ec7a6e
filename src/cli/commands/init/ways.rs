//! Questions about who may reach the drives, who may command them, and by which rules.

use super::answers::{BrokerAnswers, ModbusAnswers, PageAnswers};
use super::args::Args;
use crate::cli::tools::CommandFailure;
use crate::cli::tools::questions::PersonQuestions;
use crate::cli::tools::straight_write;
use crate::config::written::NewControl;
use crate::domain::ids::{CommanderName, Name};
use ipnet::IpNet;
use std::io::BufRead;
use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};

/// What may reach the drives.
const WAYS: [&str; 5] = ["page", "modbus-tcp", "mqtt", "home-assistant", "sparkplug"];
/// What each action does, for those who decide.
const ACTIONS: [(&str, &str); 3] = [
    ("stop", "ramps the motor down"),
    ("coast", "cuts its output off"),
    ("hold", "sends nothing: the motor runs on"),
];

/// Secrets that are written once all is answered.
#[derive(Default)]
pub struct InitSecrets {
    /// Password of the page's user.
    pub page: Option<String>,
    /// Password at the broker.
    pub broker: Option<String>,
}

/// The words of `text`, separated by commas or spaces, if all are among `valid`.
pub fn words(text: &str, valid: &[&str]) -> Result<Vec<String>, String> {
    let words: Vec<_> = text
        .split([',', ' '])
        .filter(|word| !word.is_empty())
        .map(str::to_owned)
        .collect();
    match words.iter().find(|word| !valid.contains(&word.as_str())) {
        Some(wrong) => Err(format!("`{wrong}` is not one of {}", valid.join(", "))),
        None => Ok(words),
    }
}

/// Networks, separated by commas or spaces. A single address is one of itself.
fn networks(text: &str) -> Result<Vec<IpNet>, String> {
    let parts = text.split([',', ' ']).filter(|part| !part.is_empty());
    let network = |part: &str| {
        let single = part.parse::<IpAddr>().map(IpNet::from);
        part.parse::<IpNet>().or(single).map_err(|_| {
            format!("`{part}` is not a network or address, such as 10.0.0.0/24 or 10.0.0.5")
        })
    };
    let networks: Vec<_> = parts.map(network).collect::<Result<_, _>>()?;
    if networks.is_empty() {
        Err("name one at least".to_owned())
    } else {
        Ok(networks)
    }
}

fn address(text: &str) -> Result<SocketAddr, String> {
    text.parse().map_err(|_| {
        format!("`{text}` is not an address with a port, such as 127.0.0.1:8080 or 0.0.0.0:8443")
    })
}

/// Two frequencies in Hz that leave room between them.
fn limits(text: &str) -> Result<(f64, f64), String> {
    let wrong = || format!("`{text}` are not two frequencies in Hz, such as 5-50");
    straight_write::limits(text)
        .ok()
        .filter(|(least, most)| least < most)
        .ok_or_else(wrong)
}

/// The actions with what each does.
fn actions() -> String {
    ACTIONS
        .map(|(word, does)| format!("{word} ({does})"))
        .join(", ")
}

fn action(text: &str) -> Result<String, String> {
    let known = ACTIONS.iter().any(|(word, _)| *word == text);
    if known {
        Ok(text.to_owned())
    } else {
        Err(format!("`{text}` is not one of {}", actions()))
    }
}

/// The ways that are wanted.
pub fn ask_interfaces<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    args: &Args,
) -> Result<Vec<String>, CommandFailure> {
    let question = format!("Interfaces to the drives, any of {}", WAYS.join(", "));
    questions.given_or_asked(
        args.ways.as_deref(),
        "--ways",
        &question,
        Some("page"),
        |text| {
            let ways = words(text, &WAYS)?;
            if ways.is_empty() {
                Err("name one at least".to_owned())
            } else {
                Ok(ways)
            }
        },
    )
}

/// Where the page listens, and who may see it.
pub fn page<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    args: &Args,
) -> Result<PageAnswers, CommandFailure> {
    let listen = questions.given_or_asked(
        args.page_listen.as_deref(),
        "--page-listen",
        "Address of the page; 0.0.0.0:8443 for other hosts",
        Some("127.0.0.1:8080"),
        address,
    )?;
    let allow = allowed(
        questions,
        listen,
        args.page_allow.as_deref(),
        "--page-allow",
        "see the page",
    )?;
    Ok(PageAnswers {
        listen,
        allow,
        user: None,
        certificate: None,
    })
}

/// Where Modbus TCP listens, and who may read.
pub fn modbus<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    args: &Args,
) -> Result<ModbusAnswers, CommandFailure> {
    let listen = questions.given_or_asked(
        args.modbus_listen.as_deref(),
        "--modbus-listen",
        "Address of Modbus TCP; 0.0.0.0:1502 for other hosts",
        Some("127.0.0.1:1502"),
        address,
    )?;
    let allow = allowed(
        questions,
        listen,
        args.modbus_allow.as_deref(),
        "--modbus-allow",
        "read over Modbus TCP",
    )?;
    Ok(ModbusAnswers {
        listen,
        allow,
        write: Vec::new(),
    })
}

/// Who may connect; on loopback that needs no answer.
fn allowed<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    listen: SocketAddr,
    given: Option<&str>,
    flag: &str,
    what: &str,
) -> Result<Vec<IpNet>, CommandFailure> {
    if listen.ip().is_loopback() && given.is_none() {
        return Ok(Vec::new());
    }
    let question = format!("Networks that may {what}, such as 10.0.0.0/24");
    questions.given_or_asked(given, flag, &question, None, networks)
}

/// The broker. `directory` is where the password goes.
pub fn broker<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    args: &Args,
    ways: &[String],
    directory: &Path,
    secrets: &mut InitSecrets,
) -> Result<BrokerAnswers, CommandFailure> {
    let url = questions.given_or_asked(
        args.broker.as_deref(),
        "--broker",
        "Broker: mqtt://HOST:1883, or mqtts://HOST:8883 with encryption",
        None,
        |text| match text.starts_with("mqtt://") || text.starts_with("mqtts://") {
            true => Ok(text.to_owned()),
            false => Err(format!("`{text}` is not mqtt://HOST or mqtts://HOST")),
        },
    )?;
    let name = |text: &str| Ok(text.to_owned());
    let user = questions.given_or_asked(
        args.broker_user.as_deref(),
        "--broker-user",
        "User at the broker, Enter for none",
        Some(""),
        name,
    )?;
    let user = if user.is_empty() {
        None
    } else {
        secrets.broker = Some(questions.secret("Password at the broker")?);
        Some((user, directory.join("mqtt-password")))
    };
    let has = |way: &str| ways.iter().any(|it| it == way);
    let sparkplug_group = if has("sparkplug") {
        let group = |text: &str| {
            if text.is_empty() {
                Err("an answer is needed".to_owned())
            } else {
                Ok(text.to_owned())
            }
        };
        let asked = "Sparkplug group of this gateway";
        Some(questions.given_or_asked(
            args.sparkplug_group.as_deref(),
            "--sparkplug-group",
            asked,
            None,
            group,
        )?)
    } else {
        None
    };
    Ok(BrokerAnswers {
        url,
        user,
        home_assistant: has("home-assistant"),
        sparkplug_group,
    })
}

/// Who may command, of the ways that are open; none by default.
pub fn commanders<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    args: &Args,
    ways: &[String],
) -> Result<Vec<String>, CommandFailure> {
    let mut open: Vec<&str> = Vec::new();
    for (way, from) in [
        ("page", "page"),
        ("modbus-tcp", "modbus-tcp"),
        ("mqtt", "mqtt"),
        ("home-assistant", "mqtt"),
        ("sparkplug", "sparkplug"),
    ] {
        if ways.iter().any(|it| it == way) && !open.contains(&from) {
            open.push(from);
        }
    }
    let question = format!(
        "Who may command the drives, any of {}; Enter for none",
        open.join(", ")
    );
    questions.given_or_asked(
        args.command_from.as_deref(),
        "--command-from",
        &question,
        Some(""),
        |text| words(text, &open),
    )
}

/// The rules of control. What happens to the motor when its client is lost has no default.
pub fn control<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    args: &Args,
    from: Vec<String>,
) -> Result<NewControl, CommandFailure> {
    let limits_hz = questions.given_or_asked(
        args.limits.as_deref(),
        "--limits",
        "Lowest and highest frequency in Hz, such as 5-50",
        None,
        limits,
    )?;
    let has_reverse = questions.given_or_asked(
        args.directions.as_deref(),
        "--directions",
        "Directions: forward, or both",
        Some("forward"),
        |text| match text {
            "forward" => Ok(false),
            "both" => Ok(true),
            other => Err(format!("`{other}` is neither forward nor both")),
        },
    )?;
    let lost = format!("When the client is lost: {}", actions());
    let on_commander_lost = questions.given_or_asked(
        args.on_commander_lost.as_deref(),
        "--on-commander-lost",
        &lost,
        None,
        action,
    )?;
    let silent = "How long may the client be silent before that, such as 10s";
    let lost_after = questions.given_or_asked(
        args.lost_after.as_deref(),
        "--lost-after",
        silent,
        None,
        |text| {
            if text.is_empty() {
                Err("an answer is needed".to_owned())
            } else {
                Ok(text.to_owned())
            }
        },
    )?;
    let end = "When the gateway is shut down: stop, coast or hold";
    let on_shutdown = questions.given_or_asked(
        args.on_shutdown.as_deref(),
        "--on-shutdown",
        end,
        None,
        action,
    )?;
    let accepts_unproven = false;
    Ok(NewControl {
        from,
        limits_hz,
        has_reverse,
        on_commander_lost,
        lost_after,
        on_shutdown,
        accepts_unproven,
    })
}

/// Who may command over Modbus TCP.
pub fn writers<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    args: &Args,
) -> Result<Vec<IpNet>, CommandFailure> {
    let question = "Addresses that may command over Modbus TCP, such as 10.0.0.5";
    questions.given_or_asked(
        args.modbus_write.as_deref(),
        "--modbus-write",
        question,
        None,
        networks,
    )
}

/// Who signs in to the page. `directory` is where the hash goes.
pub fn page_user<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    args: &Args,
    directory: &Path,
    secrets: &mut InitSecrets,
) -> Result<(String, PathBuf), CommandFailure> {
    let name = questions.given_or_asked(
        args.page_user.as_deref(),
        "--page-user",
        "Name of the page's user",
        None,
        |text| match CommanderName::new(text) {
            Some(_) => Ok(text.to_owned()),
            None => Err(format!(
                "a name has 1 to {} {}",
                CommanderName::MAX_CHARS,
                Name::RULE
            )),
        },
    )?;
    secrets.page = Some(questions.secret("Password of this user, 8 characters at least")?);
    let file = directory.join(format!("{name}.hash"));
    Ok((name, file))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_are_read_as_they_are_written() {
        assert_eq!(words("page, mqtt", &WAYS).unwrap(), ["page", "mqtt"]);
        assert!(
            words("pgae", &WAYS)
                .unwrap_err()
                .contains("not one of page, modbus-tcp")
        );
        assert_eq!(networks("10.0.0.5 10.1.0.0/16").unwrap().len(), 2);
        assert!(networks("10.0.0").is_err() && address("8080").is_err());
        assert_eq!(limits("5 - 50.5"), Ok((5.0, 50.5)));
        assert!(limits("50-5").is_err() && limits("5").is_err());
        let halt = action("halt").unwrap_err();
        assert!(
            halt.contains("stop (ramps")
                && halt.contains("hold (sends nothing: the motor runs on)"),
            "{halt}"
        );
    }
}
