#!/bin/sh
# Clients without any library: stty, printf and cat, with the port as the shell opens it.
# session.sh PORT
set -eu
port=$1
heard=$(mktemp)
trap 'rm -f "$heard"' EXIT

# ask OCTAL LENGTH HEX: sends bytes, and compares the first of what comes with what is expected.
ask() {
    exec 3<>"$port"
    printf "$1" >&3
    timeout 5 head -c "$2" <&3 >"$heard" || { echo "no reply to $1" >&2; exit 1; }
    exec 3>&- 3<&-
    found=$(od -An -tx1 "$heard" | tr -d ' \n')
    case $found in
        "$3"*) ;;
        *) echo "$found instead of $3" >&2; exit 1 ;;
    esac
}

version='\252\125\000\360\367\007'
drive='\252\125\004\022\310\000\310\000\324\267'
stop='\252\125\004\022\000\000\000\000\277\155'
ask "$version" 14 aa5508f0
ask "$drive" 14 aa550812
sleep 0.06
ask "$stop" 14 aa550812
# At the wrong speed, which ends with the client that set it; that it has left takes a moment to be
# noticed on a busy machine.
(stty 9600 raw -echo; printf "$version") <"$port" >"$port"
sleep 0.3
ask "$version" 14 aa5508f0
(stty 0 || true) <"$port"
sleep 0.3
ask "$version" 14 aa5508f0
# The bytes of a redirection that ends at once go out as far as a UART holds them.
printf '\252\125\000\007\307\204' >"$port"
sleep 0.3
ask "$version" 14 aa5508f0
