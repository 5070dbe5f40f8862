//! Threads as GNU make's jobserver allows: one that make has counted already, and one for each token that is free.
//!
//! Tokens are taken once, without waiting, when the first command needs threads, and given back when the program ends,
//! by Ctrl-C too. Where make names a jobserver that can't be reached (a recipe without `+`), one thread works, as GNU make
//! and GCC's `-flto=jobserver` do then.

use crate::notes;
use jobserver::{Acquired, Client, FromEnvErrorKind};
use std::sync::{Mutex, PoisonError};

enum Server {
    /// None is named, or nothing was looked for yet.
    None,
    Found(Client),
    Unreachable,
}

struct State {
    server: Server,
    /// Threads that were granted, once they were asked for.
    threads: Option<usize>,
    tokens: Vec<Acquired>,
}

static STATE: Mutex<State> = Mutex::new(State { server: Server::None, threads: None, tokens: Vec::new() });

/// Looks for a jobserver. To be called before any file is opened.
pub(crate) fn connect() {
    // SAFETY: the descriptors that MAKEFLAGS names are the parent's gift to this process, and nothing here has opened any
    // that could stand in their place yet; they are checked to be pipes.
    let found = unsafe { Client::from_env_ext(true) };
    let server = match found.client {
        Ok(client) => Server::Found(client),
        Err(error) => match error.kind() {
            FromEnvErrorKind::NoEnvVar | FromEnvErrorKind::NoJobserver | FromEnvErrorKind::Unsupported => {
                Server::None
            }
            _ => Server::Unreachable,
        },
    };
    STATE.lock().unwrap_or_else(PoisonError::into_inner).server = server;
}

/// Threads for a command that was not told how many; `cores` at most.
pub(crate) fn threads(cores: usize) -> usize {
    let mut state = STATE.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(threads) = state.threads {
        return threads;
    }
    let mut tokens = Vec::new();
    let threads = match &state.server {
        Server::None => cores,
        Server::Unreachable => {
            notes::print(&[
                "make's jobserver can't be reached, so one thread works; begin the recipe with + or give -j"
                    .to_owned(),
            ]);
            1
        }
        Server::Found(client) => {
            // A pipe that can't be asked without waiting gives none.
            let free = std::iter::from_fn(|| client.try_acquire().ok().flatten());
            tokens.extend(free.take(cores.saturating_sub(1)));
            1 + tokens.len()
        }
    };
    state.tokens = tokens;
    state.threads = Some(threads);
    threads
}

/// Gives all tokens back. Nothing that uses threads may follow.
pub(crate) fn release() {
    STATE.lock().unwrap_or_else(PoisonError::into_inner).tokens.clear();
}
