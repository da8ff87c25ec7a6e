//! What is released is installed as others do it: only what was signed, and from an apt repository.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A release with a package and a program that only say who they are.
struct Release {
    place: PathBuf,
}

fn run(command: &mut Command) -> Output {
    command
        .output()
        .unwrap_or_else(|error| panic!("{command:?}: {error}; run tests/run, which installs it"))
}

fn succeeds(command: &mut Command) -> String {
    let output = run(command);
    assert!(output.status.success(), "{command:?}: {output:?}");
    String::from_utf8(output.stdout).unwrap()
}

fn script(name: &str) -> Command {
    Command::new(super::root().join("release").join(name))
}

/// A package of this name and version with one file in it.
fn package(place: &Path, version: &str) -> PathBuf {
    let root = place.join(format!("root-{version}"));
    fs::create_dir_all(root.join("DEBIAN")).unwrap();
    fs::create_dir_all(root.join("usr/share/doc/vfd-gateway")).unwrap();
    let control = format!(
        "Package: vfd-gateway\nVersion: {version}\nArchitecture: {}\nMaintainer: nobody <nobody@example.org>\n\
         Description: stands for the real one\n",
        succeeds(Command::new("dpkg").arg("--print-architecture")).trim()
    );
    fs::write(root.join("DEBIAN/control"), control).unwrap();
    fs::write(root.join("usr/share/doc/vfd-gateway/version"), version).unwrap();
    let architecture = succeeds(Command::new("dpkg").arg("--print-architecture"));
    let file = place.join(format!(
        "out/vfd-gateway_{version}_{}.deb",
        architecture.trim()
    ));
    succeeds(
        Command::new("dpkg-deb")
            .args(["--build", "--root-owner-group"])
            .arg(&root)
            .arg(&file),
    );
    file
}

impl Release {
    fn new(name: &str) -> Self {
        let place =
            Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", std::process::id()));
        fs::create_dir_all(place.join("out")).unwrap();
        let release = Self { place };
        package(&release.place, "1.2.3");
        let machine = succeeds(Command::new("uname").arg("-m"));
        fs::write(
            release.file(&format!("out/vfd-gateway-{}", machine.trim())),
            "#!/bin/sh\necho 1.2.3\n",
        )
        .unwrap();
        for key in ["key", "other"] {
            succeeds(
                Command::new("ssh-keygen")
                    .args(["-q", "-t", "ed25519", "-N", "", "-f"])
                    .arg(release.file(key)),
            );
            let public = fs::read_to_string(release.file(&format!("{key}.pub"))).unwrap();
            fs::write(
                release.file(&format!("{key}.signers")),
                format!("release@vfd-gateway {public}"),
            )
            .unwrap();
        }
        succeeds(
            script("sign")
                .arg(release.file("out"))
                .arg(release.file("key")),
        );
        release
    }

    fn file(&self, name: &str) -> PathBuf {
        self.place.join(name)
    }

    fn install(&self, signers: &str, more: &[&str]) -> Output {
        let mut command = script("install.sh");
        command
            .arg("--from")
            .arg(self.file("out"))
            .arg("--signers")
            .arg(self.file(signers))
            .args(more);
        run(&mut command)
    }
}

impl Drop for Release {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.place);
    }
}

#[test]
fn only_what_was_signed_is_installed() {
    let release = Release::new("installed");
    let prefix = release.file("prefix");
    let to = prefix.to_str().unwrap();
    let output = release.install("key.signers", &["--prefix", to]);
    assert!(output.status.success(), "{output:?}");
    let program = prefix.join("bin/vfd-gateway");
    assert_eq!(succeeds(&mut Command::new(&program)), "1.2.3\n");
    assert_eq!(
        program.metadata().unwrap().permissions().mode() & 0o777,
        0o755
    );
    let output = release.install("key.signers", &["--check"]);
    assert!(
        output.status.success()
            && String::from_utf8_lossy(&output.stdout).contains(".deb is signed"),
        "{output:?}"
    );

    let refused = |signers: &str, what: &str| {
        let other = release.file("refused");
        let output = release.install(signers, &["--prefix", other.to_str().unwrap()]);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            !output.status.success() && said.contains(what) && !other.exists(),
            "{output:?}"
        );
    };
    refused("other.signers", "is not that of release@vfd-gateway");
    let machine = succeeds(Command::new("uname").arg("-m"));
    fs::write(
        release.file(&format!("out/vfd-gateway-{}", machine.trim())),
        "#!/bin/sh\necho worse\n",
    )
    .unwrap();
    refused("key.signers", "is not what was signed");
    let sums = fs::read_to_string(release.file("out/SHA256SUMS")).unwrap();
    fs::write(release.file("out/SHA256SUMS"), sums.replace('a', "b")).unwrap();
    refused("key.signers", "is not that of release@vfd-gateway");
    fs::remove_file(release.file("out/SHA256SUMS.sig")).unwrap();
    refused("key.signers", "cannot be read");
    let output = run(script("install.sh")
        .args(["--from", "http://example.org", "--signers"])
        .arg(release.file("key.signers")));
    assert!(
        String::from_utf8_lossy(&output.stderr).contains("https:// is needed"),
        "{output:?}"
    );
}

#[test]
fn an_apt_repository_is_read_by_apt_itself() {
    let release = Release::new("apt");
    let home = release.file("gnupg");
    fs::create_dir(&home).unwrap();
    fs::set_permissions(&home, fs::Permissions::from_mode(0o700)).unwrap();
    let user = "release <release@example.org>";
    succeeds(Command::new("gpg").env("GNUPGHOME", &home).args([
        "--batch",
        "--quiet",
        "--passphrase",
        "",
        "--quick-generate-key",
        user,
        "ed25519",
        "sign",
        "never",
    ]));
    let repository = release.file("repository");
    let make = |package: &Path| {
        run(script("apt")
            .env("GNUPGHOME", &home)
            .arg(&repository)
            .arg("release@example.org")
            .arg(package))
    };
    let first = package(&release.place, "1.2.3");
    assert!(make(&first).status.success());
    let second = make(&package(&release.place, "1.3.0"));
    assert!(
        String::from_utf8_lossy(&second.stdout).contains("2 packages"),
        "{second:?}"
    );
    // The same version with another content was released by mistake.
    fs::write(
        release.file("root-1.2.3/usr/share/doc/vfd-gateway/version"),
        "other",
    )
    .unwrap();
    let other = release.file("other.deb");
    succeeds(
        Command::new("dpkg-deb")
            .args(["--build", "--root-owner-group"])
            .arg(release.file("root-1.2.3"))
            .arg(&other),
    );
    let output = make(&other);
    assert!(
        String::from_utf8_lossy(&output.stderr).contains("there already"),
        "{output:?}"
    );

    let root = release.file("host");
    for directory in [
        "etc/apt/apt.conf.d",
        "etc/apt/preferences.d",
        "state/lists/partial",
        "cache/archives/partial",
    ] {
        fs::create_dir_all(root.join(directory)).unwrap();
    }
    fs::write(root.join("status"), "").unwrap();
    let key = repository.join("vfd-gateway.asc");
    let source = format!(
        "deb [signed-by={}] file:{} stable main\n",
        key.display(),
        repository.display()
    );
    fs::write(root.join("etc/apt/sources.list"), source).unwrap();
    let apt = |tool: &str, args: &[&str]| {
        let mut command = Command::new(tool);
        for (option, path) in [
            ("Dir::Etc", "etc/apt"),
            ("Dir::State", "state"),
            ("Dir::State::status", "status"),
            ("Dir::Cache", "cache"),
        ] {
            command
                .arg("-o")
                .arg(format!("{option}={}", root.join(path).display()));
        }
        // The tests may run as root, whose files the user that apt fetches as cannot read.
        run(command.args(["-o", "APT::Sandbox::User=root"]).args(args))
    };
    let updated = apt("apt-get", &["update"]);
    let said = String::from_utf8_lossy(&updated.stderr).into_owned();
    assert!(
        updated.status.success() && !said.contains("W:") && !said.contains("E:"),
        "{updated:?}"
    );
    let policy = apt("apt-cache", &["policy", "vfd-gateway"]);
    assert!(
        String::from_utf8_lossy(&policy.stdout).contains("Candidate: 1.3.0"),
        "{policy:?}"
    );
    fs::write(
        repository.join("dists/stable/InRelease"),
        "nothing that was signed\n",
    )
    .unwrap();
    fs::remove_file(repository.join("dists/stable/Release.gpg")).unwrap();
    let changed = apt("apt-get", &["update"]);
    let said = String::from_utf8_lossy(&changed.stderr).into_owned();
    assert!(
        !changed.status.success() || said.contains("is not signed") || said.contains("W:"),
        "{changed:?}"
    );
}
