// What libzmq wants of the standard header of this name, for static files: addresses as numbers, without the names of hosts and services.
//
// The C library's own functions ask whatever /etc/nsswitch.conf names, for which a static file would have to load, at run time, the very
// libraries that it was built with, and a brick's are others. Without them and without the look-up of groups (`src/runtime/groups.rs`) the
// brick's file is 127 kB smaller; each alone gives little. A name is answered as one that nobody knows.
//
// `src/build.rs` puts this folder before the compiler's own.

#pragma once

#include_next <netdb.h>

#include <arpa/inet.h>
#include <net/if.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>

#include <new>

namespace zmq
{
// An answer and the address that it points to.
struct numeric_address
{
    addrinfo info;
    sockaddr_storage address;
};

// Of the standard's function what libzmq asks for: a host, no service, one answer at most.
inline int numeric_getaddrinfo (const char *host_,
                                const char *service_,
                                const addrinfo *hints_,
                                addrinfo **answer_)
{
    if (!host_ || service_)
        return EAI_NONAME;
    const int family = hints_ ? hints_->ai_family : AF_UNSPEC;
    const int flags = hints_ ? hints_->ai_flags : 0;
    in_addr v4;
    in6_addr v6;
    // inet_aton ends at a space.
    bool is_v4 = !strpbrk (host_, " \t\n\v\f\r") && inet_aton (host_, &v4) == 1;
    const bool is_v6 = !is_v4 && inet_pton (AF_INET6, host_, &v6) == 1;
    if (is_v4 && family == AF_INET6 && (flags & AI_V4MAPPED)) {
        memset (&v6, 0, sizeof v6);
        memset (v6.s6_addr + 10, 0xff, 2);
        memcpy (v6.s6_addr + 12, &v4, sizeof v4);
        is_v4 = false;
    } else if (is_v6 && family == AF_INET && IN6_IS_ADDR_V4MAPPED (&v6)) {
        memcpy (&v4, v6.s6_addr + 12, sizeof v4);
        is_v4 = true;
    } else if (!(is_v4 && family != AF_INET6) && !(is_v6 && family != AF_INET))
        return EAI_NONAME;

    numeric_address *const found = new (std::nothrow) numeric_address ();
    if (!found)
        return EAI_MEMORY;
    if (is_v4) {
        sockaddr_in *const in = reinterpret_cast<sockaddr_in *> (&found->address);
        in->sin_family = AF_INET;
        in->sin_addr = v4;
        found->info.ai_addrlen = sizeof *in;
    } else {
        sockaddr_in6 *const in =
          reinterpret_cast<sockaddr_in6 *> (&found->address);
        in->sin6_family = AF_INET6;
        in->sin6_addr = v6;
        found->info.ai_addrlen = sizeof *in;
    }
    found->info.ai_family = found->address.ss_family;
    found->info.ai_socktype = hints_ ? hints_->ai_socktype : 0;
    found->info.ai_protocol = hints_ ? hints_->ai_protocol : 0;
    found->info.ai_addr = reinterpret_cast<sockaddr *> (&found->address);
    *answer_ = &found->info;
    return 0;
}

inline void numeric_freeaddrinfo (addrinfo *answer_)
{
    delete reinterpret_cast<numeric_address *> (answer_);
}

// Of the standard's function what libzmq asks for: the host's number; that of a link's own with the interface that it is behind.
inline int numeric_getnameinfo (const sockaddr *address_,
                                socklen_t address_length_,
                                char *host_,
                                socklen_t host_length_,
                                char *service_,
                                socklen_t,
                                int flags_)
{
    if (!host_ || service_ || !(flags_ & NI_NUMERICHOST))
        return EAI_NONAME;
    if (address_length_ >= sizeof (sockaddr_in)
        && address_->sa_family == AF_INET) {
        const sockaddr_in *const in =
          reinterpret_cast<const sockaddr_in *> (address_);
        return inet_ntop (AF_INET, &in->sin_addr, host_, host_length_)
                 ? 0
                 : EAI_OVERFLOW;
    }
    if (address_length_ < sizeof (sockaddr_in6)
        || address_->sa_family != AF_INET6)
        return EAI_FAMILY;
    const sockaddr_in6 *const in =
      reinterpret_cast<const sockaddr_in6 *> (address_);
    if (!inet_ntop (AF_INET6, &in->sin6_addr, host_, host_length_))
        return EAI_OVERFLOW;
    if (in->sin6_scope_id == 0)
        return 0;
    char interface[IF_NAMESIZE];
    const bool is_links_own = IN6_IS_ADDR_LINKLOCAL (&in->sin6_addr)
                              || IN6_IS_ADDR_MC_LINKLOCAL (&in->sin6_addr);
    const bool has_name =
      is_links_own && if_indextoname (in->sin6_scope_id, interface);
    if (!has_name)
        snprintf (interface, sizeof interface, "%u",
                  static_cast<unsigned> (in->sin6_scope_id));
    const size_t used = strlen (host_);
    if (used + 1 + strlen (interface) >= host_length_)
        return EAI_OVERFLOW;
    host_[used] = '%';
    strcpy (host_ + used + 1, interface);
    return 0;
}
}

#define getaddrinfo zmq::numeric_getaddrinfo
#define freeaddrinfo zmq::numeric_freeaddrinfo
#define getnameinfo zmq::numeric_getnameinfo
