//! `relight preview` in a window of a virtual screen, dragged and typed at by xdotool.
//!
//! Without Xvfb, xdotool or an adapter for windows the test says that it skips, unless
//! RELIGHT_REQUIRE_GPU is 1.

#![cfg(all(feature = "gpu", target_os = "linux"))]
#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::pictures::read_png;
use scene::{command, copy_icon72, made, names_in, outcome, relight};
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A process that ends with the test.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A virtual screen and its name.
fn screen() -> Option<(Ended, String)> {
    let mut xvfb = Command::new("Xvfb");
    xvfb.args(["-displayfd", "1", "-screen", "0", "900x800x24"]).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut child = xvfb.spawn().ok()?;
    let mut number = String::new();
    BufReader::new(child.stdout.take()?).read_line(&mut number).ok()?;
    Some((Ended(child), format!(":{}", number.trim())))
}

/// Runs xdotool on that screen; what it says.
fn xdotool(screen: &str, line: &str) -> String {
    let output =
        Command::new("xdotool").args(line.split_whitespace()).env("DISPLAY", screen).output().unwrap();
    String::from_utf8(output.stdout).unwrap().trim().to_owned()
}

/// What `look` finds, within a minute.
#[track_caller]
fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let end = Instant::now() + Duration::from_secs(60);
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(Instant::now() < end, "no {what} within a minute");
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn skip(why: &str) {
    assert!(std::env::var("RELIGHT_REQUIRE_GPU").is_err(), "RELIGHT_REQUIRE_GPU is set: {why}");
    eprintln!("skipped: {why}");
}

/// The largest difference of two 8-bit PNGs, in codes.
fn difference(a: &Path, b: &Path) -> f64 {
    let (a, b) = (read_png(a).0, read_png(b).0);
    assert_eq!((a.width, a.height), (b.width, b.height));
    let pairs = a.samples.iter().zip(&b.samples);
    pairs.map(|(a, b)| (a - b).abs() * 255.0).fold(0.0, f64::max)
}

#[test]
fn dragging_moves_the_light_and_s_saves_what_render_draws() {
    if Command::new("xdotool").arg("version").output().is_err() {
        return skip("no xdotool");
    }
    let Some((_xvfb, screen)) = screen() else { return skip("no Xvfb") };
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    copy_icon72(&here.join("capture"), 4);
    relight(here, "bake capture -o a.ktx2 --block bc7 --quality fast").ok();
    let mut program = command(here);
    program.args(["preview", "a.ktx2", "--light", "0.6,0,0.8", "--size", "400x400"]);
    program.env("DISPLAY", &screen).env("XDG_RUNTIME_DIR", here).env_remove("WAYLAND_DISPLAY");
    let mut preview = Ended(program.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap());
    // The title shows the light once the first picture was drawn.
    let window = wait_for("window", || {
        if preview.0.try_wait().unwrap().is_some() {
            return Some(String::new());
        }
        Some(xdotool(&screen, "search --name light")).filter(|windows| !windows.is_empty())
    });
    if window.is_empty() {
        let mut words = String::new();
        preview.0.stderr.take().unwrap().read_to_string(&mut words).unwrap();
        assert_eq!(preview.0.wait().unwrap().code(), Some(6), "{words}");
        return skip(&words);
    }
    let mut lines = BufReader::new(preview.0.stdout.take().unwrap()).lines();
    lines.next().unwrap().unwrap();
    let mut saved = || {
        let line = lines.next().unwrap().unwrap();
        let (path, light) = line.strip_prefix("saved ").unwrap().split_once(" (--light ").unwrap();
        (here.join(path), light.trim_end_matches(')').to_owned())
    };
    let title = || xdotool(&screen, &format!("getwindowname {window}"));
    xdotool(&screen, &format!("windowfocus --sync {window}"));
    xdotool(&screen, "key s");
    let first = saved();
    assert!(first.0.ends_with("a_light_0.600_0.000_0.800.png"), "{}", first.0.display());

    xdotool(&screen, &format!("mousemove --window {window} 200 200 mousedown 1"));
    wait_for("light straight above", || title().contains("0.000, 0.000, 1.000").then_some(()));
    xdotool(&screen, &format!("mousemove --window {window} 80 120 mouseup 1"));
    // 120 left and 80 up of a radius of 200.
    wait_for("light from the upper left", || title().contains("-0.600, 0.400, 0.693").then_some(()));
    // The button is up: the light stays.
    xdotool(&screen, &format!("mousemove --window {window} 300 300"));
    xdotool(&screen, "key s");
    let second = saved();
    xdotool(&screen, "key s");
    let again = saved();
    for (path, light) in [&first, &second, &again] {
        relight(here, &format!("render a.ktx2 -o r.png --light {light}")).ok();
        assert!(difference(path, &here.join("r.png")) <= 2.0, "{}", path.display());
    }
    assert!(difference(&first.0, &second.0) > 50.0, "the light moved");
    assert_ne!(second.0, again.0, "nothing is overwritten");

    for (key, words) in [
        ("2", "map 0 of 0..5"),
        ("Right", "map 1 of"),
        ("Left", "map 0 of"),
        ("space", "difference from the CPU"),
        ("r", "0.600, 0.000, 0.800 | relit"),
        ("h", "Esc: quit"),
    ] {
        xdotool(&screen, &format!("key {key}"));
        wait_for(words, || title().contains(words).then_some(()));
    }
    xdotool(&screen, "key Escape");
    wait_for("end", || preview.0.try_wait().unwrap()).success().then_some(()).unwrap();
    let pictures = names_in(here).into_iter().filter(|name| name.starts_with("a_light")).count();
    assert_eq!(pictures, 3);
}

#[test]
fn without_a_window_system_it_says_so_in_a_sentence() {
    let folder = made(16);
    let here = folder.path();
    relight(here, "bake capture -o a.ktx2").ok();
    let mut program = command(here);
    for name in ["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"] {
        program.env_remove(name);
    }
    let refused = outcome("preview a.ktx2".to_owned(), program.args(["preview", "a.ktx2"]).output().unwrap());
    refused.assert_refused(6, &["no window system", "relight render"]);
}
