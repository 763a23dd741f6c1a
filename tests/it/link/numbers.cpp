// `src/link/libzmq/netdb.h` beside the C library's own functions: the same answers to everything that is a number. `numbers.rs` runs it.

#include <netdb.h>

#undef getaddrinfo
#undef freeaddrinfo
#undef getnameinfo

#include <net/if.h>

#include <cstdio>
#include <cstring>
#include <string>

static int differences = 0;

static void expect (bool is_so_, const std::string &what_)
{
    if (is_so_)
        return;
    printf ("%s\n", what_.c_str ());
    ++differences;
}

static void compare_answers (const char *host_, int family_, int flags_)
{
    const std::string what = std::string ("'") + host_ + "', family " + std::to_string (family_) + ", flags " + std::to_string (flags_);
    addrinfo hints;
    memset (&hints, 0, sizeof hints);
    hints.ai_family = family_;
    hints.ai_flags = flags_ | AI_NUMERICHOST;
    hints.ai_socktype = SOCK_STREAM;
    addrinfo *theirs = NULL, *ours = NULL;
    const int their_code = getaddrinfo (host_, NULL, &hints, &theirs);
    const int our_code = zmq::numeric_getaddrinfo (host_, NULL, &hints, &ours);
    expect ((their_code == 0) == (our_code == 0), what + ": " + std::to_string (their_code) + " and " + std::to_string (our_code));
    if (their_code == 0 && our_code == 0) {
        expect (ours->ai_next == NULL && ours->ai_family == theirs->ai_family && ours->ai_socktype == theirs->ai_socktype
                  && ours->ai_addrlen == theirs->ai_addrlen && memcmp (ours->ai_addr, theirs->ai_addr, theirs->ai_addrlen) == 0,
                what + ": another address");
        // And back, with the interface that a link's own address is behind.
        for (unsigned scope = 0; scope < 2; ++scope) {
            if (theirs->ai_family == AF_INET6)
                reinterpret_cast<sockaddr_in6 *> (theirs->ai_addr)->sin6_scope_id = scope;
            for (socklen_t length = 1; length < 64; ++length) {
                char their_name[64] = "", our_name[64] = "";
                const int their_name_code = getnameinfo (theirs->ai_addr, theirs->ai_addrlen, their_name, length, NULL, 0, NI_NUMERICHOST);
                const int our_name_code = zmq::numeric_getnameinfo (theirs->ai_addr, theirs->ai_addrlen, our_name, length, NULL, 0, NI_NUMERICHOST);
                expect ((their_name_code == 0) == (our_name_code == 0) && (their_name_code != 0 || strcmp (their_name, our_name) == 0),
                        what + ", " + std::to_string (length) + " bytes: '" + their_name + "' and '" + our_name + "'");
            }
        }
    }
    if (theirs)
        freeaddrinfo (theirs);
    zmq::numeric_freeaddrinfo (ours);
}

int main ()
{
    const char *const hosts[] = {"127.0.0.1", "0.0.0.0", "255.255.255.255", "10.0.0.256", "1.2.3", "10.1", "1", "0x7f.1", "010.0.0.1", "1.2.3.4.5",
                                 "::", "::1", "fe80::1", "ff02::1", "fe80::1:2:3:4", "2001:db8::a:b", "::ffff:1.2.3.4", "1::2::3", "[::1]", "::1.2.3.4",
                                 "12345::", "1:2:3:4:5:6:7:8", "1:2:3:4:5:6:7:8:9", "localhost", "ev3.local", "usb0", "*", "", " 127.0.0.1", "127.0.0.1 "};
    const int families[] = {AF_UNSPEC, AF_INET, AF_INET6};
    const int flags[] = {0, AI_PASSIVE, AI_V4MAPPED, AI_PASSIVE | AI_V4MAPPED};
    for (const char *host : hosts)
        for (int family : families)
            for (int flag : flags)
                compare_answers (host, family, flag);

    // What libzmq does not ask is refused, and so are addresses of other kinds.
    addrinfo *answer = NULL;
    expect (zmq::numeric_getaddrinfo (NULL, NULL, NULL, &answer) == EAI_NONAME, "no host");
    expect (zmq::numeric_getaddrinfo ("::1", "http", NULL, &answer) == EAI_NONAME, "a service");
    sockaddr local;
    memset (&local, 0, sizeof local);
    local.sa_family = AF_UNIX;
    char name[64];
    expect (zmq::numeric_getnameinfo (&local, sizeof local, name, sizeof name, NULL, 0, NI_NUMERICHOST) == EAI_FAMILY, "a path");
    sockaddr_in6 cut;
    memset (&cut, 0, sizeof cut);
    cut.sin6_family = AF_INET6;
    expect (zmq::numeric_getnameinfo (reinterpret_cast<sockaddr *> (&cut), sizeof (sockaddr_in), name, sizeof name, NULL, 0, NI_NUMERICHOST) == EAI_FAMILY, "half an address");
    return differences == 0 ? 0 : 1;
}
