# Sourced by script/test and script/demo: finds or installs what the build and the viewer need.
# shellcheck shell=bash

say() { printf '\n== %s\n' "$*"; }

fail() {
    printf 'error: %s\n' "$*" >&2
    exit 2
}

have() { command -v "$1" >/dev/null 2>&1; }

# Whether the dynamic linker knows a library.
have_library() {
    local ldconfig
    ldconfig=$(command -v ldconfig || echo /sbin/ldconfig)
    [[ $("$ldconfig" -p 2>/dev/null) = *"$1"* ]]
}

# Whether a Vulkan driver is registered: a graphics card's, or Mesa's software driver (lavapipe).
have_vulkan_driver() {
    [ -n "${VK_DRIVER_FILES:-}${VK_ICD_FILENAMES:-}" ] && return 0
    local file
    for file in /usr/share/vulkan/icd.d/*.json /etc/vulkan/icd.d/*.json \
        /usr/local/share/vulkan/icd.d/*.json; do
        [ -e "$file" ] && return 0
    done
    return 1
}

# Installs Debian or Ubuntu packages, as root or through sudo.
install_packages() {
    local as_root=()
    if [ "$(id -u)" -ne 0 ]; then
        have sudo || fail "these packages are missing and neither root nor sudo is at hand; install them: $*"
        as_root=(sudo)
    fi
    say "installing $*"
    "${as_root[@]}" apt-get update -qq || echo "the package lists could not be refreshed; trying with those at hand" >&2
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" ||
        fail "apt-get could not install: $*"
}

# System packages: a C and C++ toolchain, Vulkan with at least a software driver; with "window", what a window under X11
# loads at run time; with "tests", that too, an X server without a screen, and what else tests run beside cargo.
ensure_system() {
    local missing=()
    have cc && have c++ || missing+=(build-essential)
    have pkg-config || missing+=(pkg-config)
    if [ "${1:-}" = tests ]; then
        have python3 || missing+=(python3)
        [ "$(uname -s)" != Linux ] || have Xvfb || missing+=(xvfb)
    fi
    if ! have cargo && ! [ -x "$HOME/.cargo/bin/cargo" ]; then
        have curl || missing+=(curl ca-certificates)
    fi
    if [ "$(uname -s)" = Linux ]; then
        have_library libvulkan.so.1 || missing+=(libvulkan1)
        have_vulkan_driver || missing+=(mesa-vulkan-drivers)
        if [ "${1:-}" = window ] || [ "${1:-}" = tests ]; then
            have_library libX11-xcb.so.1 || missing+=(libx11-xcb1)
            have_library libXcursor.so.1 || missing+=(libxcursor1)
            have_library libXi.so.6 || missing+=(libxi6)
            have_library libxkbcommon-x11.so.0 || missing+=(libxkbcommon-x11-0)
        fi
    fi
    [ ${#missing[@]} -eq 0 ] && return 0
    have apt-get || fail "this system has no apt-get; install the counterparts of these Debian packages: ${missing[*]}"
    install_packages "${missing[@]}"
}

# Rust: by rustup if there is no cargo; rust-toolchain.toml names the version.
ensure_rust() {
    if ! have cargo && [ -x "$HOME/.cargo/bin/cargo" ]; then
        PATH="$HOME/.cargo/bin:$PATH"
    fi
    if ! have cargo; then
        say "installing Rust with rustup into ~/.cargo and ~/.rustup"
        curl --proto '=https' --tlsv1.2 -sSf https://sh.rustup.rs |
            sh -s -- -y --quiet --profile minimal --default-toolchain none --no-modify-path ||
            fail "rustup could not be installed; see https://rustup.rs"
        PATH="$HOME/.cargo/bin:$PATH"
    fi
    if have rustup; then
        rustup show active-toolchain >/dev/null 2>&1 || rustup toolchain install ||
            fail "the toolchain that rust-toolchain.toml names could not be installed"
    fi
    export PATH
}

# Prints the folder that cargo builds into: what CARGO_TARGET_DIR says, else cargo, whose configuration may name another
# than target/. It answers with one line of JSON about our own manifests only, so the key is there once. JSON escapes a
# quote or a backslash in a path; such a path is not understood, and that is told.
target_directory() {
    local directory=${CARGO_TARGET_DIR:-}
    [ -n "$directory" ] ||
        directory=$(cargo metadata --locked --no-deps --format-version 1 |
            sed -n 's/.*"target_directory":"\([^"]*\)".*/\1/p')
    case $directory in
        '' | *\\*) fail "it is not clear where cargo builds; say so with CARGO_TARGET_DIR" ;;
    esac
    printf '%s\n' "$directory"
}
