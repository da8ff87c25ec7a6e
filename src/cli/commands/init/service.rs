//! The gateway as a service of systemd: what has to be done, as a list that is shown first, and doing it.

use crate::cli::tools::{CommandFailure, print};
use crate::daemon::host::whole_files::{self, FileReaders};
use rustix::process::geteuid;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The file that the service runs with.
pub const CONFIGURATION: &str = "/etc/vfd-gateway/vfd-gateway.toml";
/// The service as the Debian package brings it.
const UNIT: &str = include_str!("../../../../deploy/systemd/vfd-gateway.service");
/// The user of the service, as the Debian package creates it.
const SYSUSERS: &str = include_str!("../../../../deploy/systemd/vfd-gateway.sysusers");
/// The program in the unit, where the package has it.
const PROGRAM: &str = "/usr/bin/vfd-gateway";
/// Where the program goes if no package has brought it.
const OWN_PROGRAM: &str = "/usr/local/bin/vfd-gateway";
/// The directory that the unit makes for the journal.
const DATA_DIR: &str = "/var/lib/vfd-gateway";

/// What is wanted of the service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WantedService {
    /// Nothing.
    None,
    /// The service is installed.
    Install,
    /// The service is installed, runs, and starts with the host.
    Start,
}

/// The words of the answers.
pub const WANTED: [(&str, WantedService); 3] = [
    ("none", WantedService::None),
    ("install", WantedService::Install),
    ("start", WantedService::Start),
];

/// What there is.
#[derive(Clone, Debug)]
pub struct ServiceFacts {
    /// The program that runs now.
    pub program: PathBuf,
    /// A unit is there already, from a package or an earlier time.
    pub has_unit: bool,
}

/// One thing to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ServiceStep {
    /// Write a file that everybody may read.
    Write(PathBuf, String),
    /// Copy the program.
    Copy(PathBuf, PathBuf),
    /// Run a program.
    Run(Vec<String>),
}

impl fmt::Display for ServiceStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Write(path, _) => write!(f, "write {}", path.display()),
            Self::Copy(from, to) => write!(f, "install -m 755 {} {}", from.display(), to.display()),
            Self::Run(words) => f.write_str(&words.join(" ")),
        }
    }
}

impl ServiceFacts {
    /// What there is on this host.
    pub fn of_host() -> Self {
        let units = [
            "/etc/systemd/system",
            "/usr/lib/systemd/system",
            "/lib/systemd/system",
        ];
        let has_unit = units
            .iter()
            .any(|dir| Path::new(dir).join("vfd-gateway.service").exists());
        Self {
            program: std::env::current_exe().unwrap_or_default(),
            has_unit,
        }
    }
}

/// Why a service cannot be installed here; `None` if it can.
pub fn why_not(out: &Path) -> Option<String> {
    if !Path::new("/run/systemd/system").is_dir() {
        return Some("this host does not run systemd".to_owned());
    }
    if !geteuid().is_root() {
        return Some(format!(
            "only root can: sudo vfd-gateway init --out {CONFIGURATION} --service start"
        ));
    }
    (out != Path::new(CONFIGURATION))
        .then(|| format!("the service reads {CONFIGURATION}: use --out {CONFIGURATION}"))
}

/// What has to be done, in order. The configuration with its secrets is there already.
pub fn steps(facts: &ServiceFacts, data_dir: &Path, wanted: WantedService) -> Vec<ServiceStep> {
    let run = |line: &str| ServiceStep::Run(line.split(' ').map(str::to_owned).collect());
    let mut steps = Vec::new();
    // What brought the unit has made its user.
    if !facts.has_unit {
        steps.push(ServiceStep::Write(
            "/etc/sysusers.d/vfd-gateway.conf".into(),
            SYSUSERS.to_owned(),
        ));
        steps.push(run("systemd-sysusers vfd-gateway.conf"));
        let program = match facts.program.to_str() {
            Some(path @ (PROGRAM | OWN_PROGRAM)) => path,
            _ => {
                steps.push(ServiceStep::Copy(facts.program.clone(), OWN_PROGRAM.into()));
                OWN_PROGRAM
            }
        };
        steps.push(ServiceStep::Write(
            "/etc/systemd/system/vfd-gateway.service".into(),
            unit(program),
        ));
    }
    if data_dir != Path::new(DATA_DIR) {
        let text = format!("[Service]\nReadWritePaths={}\n", data_dir.display());
        steps.push(ServiceStep::Write(
            "/etc/systemd/system/vfd-gateway.service.d/data-dir.conf".into(),
            text,
        ));
    }
    // Passwords and keys are read by the service alone.
    steps.push(run("chown -R root:vfd-gateway /etc/vfd-gateway"));
    steps.push(run("chmod 750 /etc/vfd-gateway"));
    steps.push(ServiceStep::Run(
        [
            "install",
            "-d",
            "-o",
            "vfd-gateway",
            "-g",
            "vfd-gateway",
            "-m",
            "700",
        ]
        .map(str::to_owned)
        .into_iter()
        .chain([data_dir.display().to_string()])
        .collect(),
    ));
    steps.push(run("systemctl daemon-reload"));
    if wanted == WantedService::Start {
        steps.push(run("systemctl enable --now vfd-gateway"));
    }
    steps
}

fn unit(program: &str) -> String {
    UNIT.replace(PROGRAM, program)
}

/// Does all `steps`, and says each one before.
///
/// # Errors
/// The first that fails, with what is left to do.
pub fn execute_steps(steps: &[ServiceStep]) -> Result<(), CommandFailure> {
    for (at, step) in steps.iter().enumerate() {
        print(&format!("  {step}\n"))?;
        done(step).map_err(|why| {
            let left: String = steps
                .iter()
                .skip(at)
                .map(|step| format!("\n  {step}"))
                .collect();
            CommandFailure::failed(format!(
                "{step}: {why}. The configuration is written. Left to do:{left}"
            ))
        })?;
    }
    Ok(())
}

fn done(step: &ServiceStep) -> Result<(), String> {
    match step {
        ServiceStep::Write(path, text) => {
            let directory = path.parent().unwrap_or(Path::new("/"));
            let made = std::fs::create_dir_all(directory);
            made.and_then(|()| whole_files::replace(path, text.as_bytes(), FileReaders::All))
                .map_err(|error| error.to_string())
        }
        // The name is replaced, because a program that runs cannot be written.
        ServiceStep::Copy(from, to) => {
            let new = to.with_extension("new");
            let copied = std::fs::copy(from, &new).and_then(|_| std::fs::rename(&new, to));
            copied.map_err(|error| error.to_string())
        }
        ServiceStep::Run(words) => {
            let Some((program, args)) = words.split_first() else {
                return Ok(());
            };
            let output = Command::new(program)
                .args(args)
                .output()
                .map_err(|error| error.to_string())?;
            let said = String::from_utf8_lossy(&output.stderr);
            if output.status.success() {
                Ok(())
            } else {
                Err(format!("{}: {}", output.status, said.trim()))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::testing::Dir;
    use std::os::unix::fs::PermissionsExt;

    fn text(steps: &[ServiceStep]) -> Vec<String> {
        steps.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_program_from_a_build_gets_a_place_and_a_unit_that_names_it() {
        let facts = ServiceFacts {
            program: "/srv/sources/target/release/vfd-gateway".into(),
            has_unit: false,
        };
        let steps = steps(&facts, Path::new(DATA_DIR), WantedService::Start);
        let expected = [
            "write /etc/sysusers.d/vfd-gateway.conf",
            "systemd-sysusers vfd-gateway.conf",
            "install -m 755 /srv/sources/target/release/vfd-gateway /usr/local/bin/vfd-gateway",
            "write /etc/systemd/system/vfd-gateway.service",
            "chown -R root:vfd-gateway /etc/vfd-gateway",
            "chmod 750 /etc/vfd-gateway",
            "install -d -o vfd-gateway -g vfd-gateway -m 700 /var/lib/vfd-gateway",
            "systemctl daemon-reload",
            "systemctl enable --now vfd-gateway",
        ];
        assert_eq!(text(&steps), expected);
        let unit = steps.iter().find_map(|step| match step {
            ServiceStep::Write(path, text) if path.ends_with("vfd-gateway.service") => Some(text),
            _ => None,
        });
        let unit = unit.unwrap();
        assert!(unit.contains(
            "\nExecStart=/usr/local/bin/vfd-gateway run -c /etc/vfd-gateway/vfd-gateway.toml\n"
        ));
        assert!(
            unit.contains("\nExecReload=/usr/local/bin/vfd-gateway reload -c "),
            "{unit}"
        );
        assert_eq!(
            unit.replace(OWN_PROGRAM, PROGRAM),
            UNIT,
            "nothing else differs"
        );
    }

    #[test]
    fn what_a_package_has_brought_stays_and_another_data_dir_is_allowed() {
        let facts = ServiceFacts {
            program: PROGRAM.into(),
            has_unit: true,
        };
        let steps = steps(&facts, Path::new("/srv/gateway"), WantedService::Install);
        let found = text(&steps);
        assert!(
            !found
                .iter()
                .any(|step| step.contains("/usr/local") || step.ends_with("vfd-gateway.service")),
            "{found:?}"
        );
        assert!(
            !found
                .iter()
                .any(|step| step.contains("enable") || step.contains("sysusers")),
            "{found:?}"
        );
        let drop_in = ServiceStep::Write(
            "/etc/systemd/system/vfd-gateway.service.d/data-dir.conf".into(),
            "[Service]\nReadWritePaths=/srv/gateway\n".to_owned(),
        );
        assert!(steps.contains(&drop_in), "{found:?}");
        assert!(
            found
                .iter()
                .any(|step| step.ends_with("-m 700 /srv/gateway")),
            "{found:?}"
        );
    }

    #[test]
    fn a_step_that_fails_tells_what_is_left() {
        let dir = Dir::new();
        let (from, to) = (dir.join("program"), dir.join("installed"));
        std::fs::write(&from, "program").unwrap();
        std::fs::set_permissions(&from, std::fs::Permissions::from_mode(0o755)).unwrap();
        let file = dir.join("made/here/unit");
        let run = |word: &str| ServiceStep::Run(vec![word.to_owned()]);
        let steps = [
            ServiceStep::Write(file.clone(), "[Unit]\n".to_owned()),
            ServiceStep::Copy(from, to.clone()),
            run("true"),
            run("false"),
            run("never"),
        ];
        let failure = execute_steps(&steps).unwrap_err().to_string();
        assert!(
            failure.starts_with("false: exit status: 1")
                && failure.ends_with("Left to do:\n  false\n  never"),
            "{failure}"
        );
        assert_eq!(std::fs::read_to_string(file).unwrap(), "[Unit]\n");
        assert_eq!(
            std::fs::metadata(to).unwrap().permissions().mode() & 0o777,
            0o755
        );
    }
}
