# Sourced by the other scripts: finds or installs what the build and the viewer need.
# shellcheck shell=bash

say() { printf '\n== %s\n' "$*"; }

fail() {
    printf 'error: %s\n' "$*" >&2
    exit 2
}

have() { command -v "$1" >/dev/null 2>&1; }

# Succeeds if the dynamic linker finds a library.
have_library() {
    local ldconfig
    ldconfig=$(command -v ldconfig || echo /sbin/ldconfig)
    [[ $("$ldconfig" -p 2>/dev/null) = *"$1"* ]]
}

# Succeeds if a Vulkan driver is registered: that of a graphics card, or Mesa's software driver (lavapipe).
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
        have sudo || fail "these packages are missing, and installing them needs root or sudo; install them: $*"
        as_root=(sudo)
    fi
    say "installing $*"
    "${as_root[@]}" apt-get update -qq || echo "the package lists could not be refreshed; trying with the present ones" >&2
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" ||
        fail "apt-get could not install: $*"
}

# Installs missing system packages: a C and C++ toolchain, and Vulkan with at least a software driver. With "window", also
# the libraries that a window under Wayland or X11 loads at run time; with "tests", also those, python3, Chromium, and an X
# server and a Wayland compositor without a screen.
ensure_system() {
    local missing=()
    have cc && have c++ || missing+=(build-essential)
    have pkg-config || missing+=(pkg-config)
    if [ "${1:-}" = tests ]; then
        have python3 || missing+=(python3)
        if ! have chromium && ! have chromium-browser && ! have google-chrome; then
            if have apt-get; then
                missing+=(chromium)
            else
                echo "SKIPPED, NOT PASSED: tests in a browser, because there is no Chromium" >&2
                export LODESTREAM_SKIP_BROWSER=1
            fi
        fi
        [ "$(uname -s)" != Linux ] || have Xvfb || missing+=(xvfb)
        [ "$(uname -s)" != Linux ] || have weston || missing+=(weston)
    fi
    if ! have cargo && ! [ -x "$HOME/.cargo/bin/cargo" ]; then
        have curl || missing+=(curl ca-certificates)
    fi
    if [ "$(uname -s)" = Linux ]; then
        have_library libvulkan.so.1 || missing+=(libvulkan1)
        have_vulkan_driver || missing+=(mesa-vulkan-drivers)
        if [ "${1:-}" = window ] || [ "${1:-}" = tests ]; then
            have_library libwayland-client.so.0 || missing+=(libwayland-client0)
            have_library libX11-xcb.so.1 || missing+=(libx11-xcb1)
            have_library libXcursor.so.1 || missing+=(libxcursor1)
            have_library libXi.so.6 || missing+=(libxi6)
            have_library libxkbcommon-x11.so.0 || missing+=(libxkbcommon-x11-0)
        fi
    fi
    [ ${#missing[@]} -eq 0 ] && return 0
    have apt-get || fail "this system has no apt-get; install the equivalents of these Debian packages: ${missing[*]}"
    install_packages "${missing[@]}"
}

# Installs Rust with rustup if there is no cargo; rust-toolchain.toml names the version.
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

# Prints cargo's target folder: CARGO_TARGET_DIR, else what cargo metadata reports, since cargo's configuration may name
# another folder than target/. With --no-deps the key occurs once. A path that JSON escapes (with a quote
# or a backslash) is an error.
target_directory() {
    local directory=${CARGO_TARGET_DIR:-}
    [ -n "$directory" ] ||
        directory=$(cargo metadata --locked --no-deps --format-version 1 |
            sed -n 's/.*"target_directory":"\([^"]*\)".*/\1/p')
    case $directory in
        '' | *\\*) fail "cargo's target folder could not be determined; set CARGO_TARGET_DIR" ;;
    esac
    printf '%s\n' "$directory"
}

# Builds the page for browsers with script/web, unless it is there and newer than its sources.
ensure_page() {
    local index sources=(web client protocol crates Cargo.lock script/web)
    index=$(target_directory)/web/index.html
    if [ -s "$index" ] && [ -z "$(find "${sources[@]}" -type f -newer "$index" -print -quit)" ]; then
        return 0
    fi
    script/web
}
