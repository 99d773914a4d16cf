# What the scripts of this folder have in common.

# Targets, each with the longest input that it gets, how many inputs a short run has, and folders
# whose files it starts from, beside those of its corpus.
targets() {
    cat <<TABLE
r150_frames 700 100000
mecanum_packets 400 100000
ascii_lines 300 100000
network 600 50000
request 600 50000
r150 2000 5000
mecanum 2000 5000
both 2000 4000
settings 4000 5000
world 4000 5000 ../worlds
rig 4000 5000 ../worlds
scenario 4000 2500 ../scenarios/r150 ../scenarios/mecanum
trace 8000 2500
document 800 300
TABLE
}

# run TARGET FOLDER ARGUMENTS...: runs a target in FOLDER, where new inputs go, on top of the
# committed ones.
run() {
    local target=$1 folder=$2 row
    shift 2
    read -r -a row < <(targets | grep "^$target ")
    local dictionary=dictionaries/$target.dict
    [ ! -e "$dictionary" ] || set -- "$@" "-dict=$dictionary"
    mkdir -p "$folder"
    # An input that takes longer than 20 s, or more than 1 GiB, is a failure like a panic.
    "target/$(rustc --print host-tuple)/release/$target" "$folder" "corpus/$target" "${row[@]:3}" \
        -max_len="${row[1]}" -timeout=20 -rss_limit_mb=1024 -artifact_prefix="artifacts/$target-" "$@"
}
