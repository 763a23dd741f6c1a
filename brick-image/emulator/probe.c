/* What the scenarios measure with, inside the emulated brick. Each form does one thing and prints
 * one number.
 *
 *   probe read FILE COUNT     nanoseconds a reading of a bare loop of pread and atoi
 *   probe hog                 eats the processor until it is killed
 *   probe enosys FROM CMD...  runs CMD under a filter: ENOSYS for every system call from FROM on
 *   probe call NUMBER         whether the kernel has a system call: exit code 0 or 1
 *   probe cpu PID             nanoseconds of processor time of a process, by its own clock
 *   probe split SECONDS PID.. samples processes; prints of each how many were user and kernel code
 *   probe now                 nanoseconds since boot
 *   probe stamp               copies lines, each with nanoseconds since boot before it
 *   probe fifo PRIORITY CMD.. runs CMD with a real-time priority
 *   probe random              how a request for random bytes that may not wait ends
 *   probe seed                tells the kernel that it has all the random numbers that it wants
 *   probe buttons             is the brick's buttons: types the letters u d l r e b of its input; a
 *                             capital is held until a dot
 *   probe frame FILE CMD...   starts CMD; prints the nanoseconds until the last pixel of a white
 *                             page is on the screen
 *   probe console FILE        whether a console shows text or graphics
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/kd.h>
#include <linux/perf_event.h>
#include <linux/random.h>
#include <linux/seccomp.h>
#include <linux/uinput.h>
#include <poll.h>
#include <sched.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/random.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

static int fail(const char *doing) {
  fprintf(stderr, "probe: %s: %s\n", doing, strerror(errno));
  return 1;
}

static long long on(clockid_t clock) {
  struct timespec time;
  if (clock_gettime(clock, &time) != 0) return -1;
  return time.tv_sec * 1000000000LL + time.tv_nsec;
}

static int read_loop(const char *path, long count) {
  char text[64];
  volatile int value = 0;
  int file = open(path, O_RDONLY | O_CLOEXEC);
  if (file < 0) return fail(path);
  long long started = on(CLOCK_MONOTONIC);
  for (long i = 0; i < count; i++) {
    ssize_t got = pread(file, text, sizeof text - 1, 0);
    if (got <= 0) return fail("pread");
    text[got] = 0;
    value = atoi(text);
  }
  printf("%lld\n", (on(CLOCK_MONOTONIC) - started) / count);
  return value < 0;
}

static int enosys(unsigned from, char **command) {
  struct sock_filter rules[] = {
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
      /* ARM's own calls (0x0f0000 on: cache flush, thread pointer) are older than everything. */
      BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, 0x0f0000, 1, 0),
      BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, from, 1, 0),
      BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
      BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | ENOSYS),
  };
  struct sock_fprog program = {sizeof rules / sizeof *rules, rules};
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) return fail("no new privileges");
  if (prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) != 0) return fail("seccomp");
  execvp(command[0], command);
  return fail(command[0]);
}

static int processor_time(pid_t pid) {
  clockid_t clock;
  if (clock_getcpuclockid(pid, &clock) != 0) return fail("processor clock");
  printf("%lld\n", on(clock));
  return 0;
}

/* Samples the processor and counts the samples of each process, all its threads. */
static int split(double seconds, int processes, char **pids) {
  enum { PAGES = 64, MOST = 8 };
  struct sample {
    struct perf_event_header header;
    unsigned long long place;
    unsigned process, thread;
  };
  struct perf_event_attr what = {
      .type = PERF_TYPE_SOFTWARE, .size = sizeof what, .config = PERF_COUNT_SW_CPU_CLOCK,
      /* In step with no rate of ticks. */
      .sample_period = 191000, .sample_type = PERF_SAMPLE_IP | PERF_SAMPLE_TID,
  };
  long counted[MOST][2] = {0};
  if (processes > MOST) return fprintf(stderr, "probe: at most %d processes\n", MOST), 1;
  int file = syscall(SYS_perf_event_open, &what, -1, 0, -1, 0);
  if (file < 0) return fail("perf_event_open");
  size_t page = sysconf(_SC_PAGESIZE), size = PAGES * page;
  char *ring = mmap(0, page + size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  if (ring == MAP_FAILED) return fail("mmap");
  struct perf_event_mmap_page *head = (void *)ring;
  long long end = on(CLOCK_MONOTONIC) + (long long)(seconds * 1e9);
  while (on(CLOCK_MONOTONIC) < end) {
    poll(0, 0, 100);
    __sync_synchronize();
    while (head->data_tail < head->data_head) {
      /* Records are multiples of 8 bytes, so a header never wraps; a sample's fields may. */
      struct sample record;
      for (size_t at = 0; at < sizeof record; at += 8)
        memcpy((char *)&record + at, ring + page + (head->data_tail + at) % size, 8);
      int in_user = (record.header.misc & PERF_RECORD_MISC_CPUMODE_MASK) == PERF_RECORD_MISC_USER;
      if (record.header.type == PERF_RECORD_SAMPLE)
        for (int i = 0; i < processes; i++)
          if (record.process == (unsigned)atoi(pids[i])) counted[i][!in_user]++;
      head->data_tail += record.header.size;
    }
  }
  for (int i = 0; i < processes; i++) printf("%ld %ld\n", counted[i][0], counted[i][1]);
  return 0;
}

static int stamp(void) {
  char line[65536];
  while (fgets(line, sizeof line, stdin)) {
    printf("%lld %s", on(CLOCK_MONOTONIC), line);
    fflush(stdout);
  }
  return 0;
}

static int fifo(int priority, char **command) {
  struct sched_param parameter = {.sched_priority = priority};
  if (sched_setscheduler(0, SCHED_FIFO, &parameter) != 0) return fail("real-time priority");
  execvp(command[0], command);
  return fail(command[0]);
}

static int seed(void) {
  struct {
    struct rand_pool_info info;
    unsigned char bytes[32];
  } pool = {.info = {.entropy_count = 8 * sizeof pool.bytes, .buf_size = sizeof pool.bytes}};
  int file = open("/dev/urandom", O_RDWR | O_CLOEXEC);
  if (file < 0) return fail("/dev/urandom");
  if (ioctl(file, RNDADDENTROPY, &pool) != 0) return fail("RNDADDENTROPY");
  return 0;
}

static int key(int device, int code, int value) {
  struct input_event events[] = {{.type = EV_KEY, .code = code, .value = value}, {.type = EV_SYN}};
  return write(device, events, sizeof events) == sizeof events ? 0 : fail("a key");
}

/* As gpio_keys has them on the brick: keys alone, no repeat. */
static int buttons(void) {
  static const char letters[] = "udlreb";
  static const int codes[] = {KEY_UP, KEY_DOWN, KEY_LEFT, KEY_RIGHT, KEY_ENTER, KEY_BACKSPACE};
  struct uinput_setup setup = {
    .id = {.bustype = BUS_HOST, .vendor = 1, .product = 1, .version = 0x100},
    .name = "EV3 Brick Buttons",
  };
  int device = open("/dev/uinput", O_WRONLY | O_CLOEXEC);
  if (device < 0) return fail("/dev/uinput");
  ioctl(device, UI_SET_PHYS, "gpio-keys/input0");
  ioctl(device, UI_SET_EVBIT, EV_KEY);
  for (size_t i = 0; i < sizeof codes / sizeof *codes; i++) ioctl(device, UI_SET_KEYBIT, codes[i]);
  if (ioctl(device, UI_DEV_SETUP, &setup) != 0 || ioctl(device, UI_DEV_CREATE) != 0)
    return fail("uinput");
  int held = 0;
  for (int letter; (letter = getchar()) != EOF;) {
    const char *known = strchr(letters, letter | 32);
    if (letter == '.' && held) key(device, held, 0), held = 0;
    if (letter <= ' ' || !known || !*known) continue;
    held = codes[known - letters];
    if (key(device, held, 1) != 0) return 1;
    if (letter < 'a') continue;
    /* As long as a finger, and until the next one. */
    usleep(80000);
    key(device, held, 0), held = 0;
    usleep(120000);
  }
  return 0;
}

static int frame(const char *path, char **command) {
  enum { LINE = 178 * 4, SIZE = LINE * 128 };
  int file = open(path, O_RDWR | O_CLOEXEC);
  if (file < 0) return fail(path);
  volatile unsigned char *screen = mmap(0, SIZE, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  if (screen == MAP_FAILED) return fail("mmap");
  memset((void *)screen, 0, SIZE);
  long long started = on(CLOCK_MONOTONIC);
  pid_t child = fork();
  if (child < 0) return fail("fork");
  if (child == 0) {
    execvp(command[0], command);
    _exit(fail(command[0]));
  }
  while (screen[SIZE - 4] != 255) {
    if (on(CLOCK_MONOTONIC) - started > 60000000000LL)
      return fprintf(stderr, "probe: no frame in a minute\n"), 1;
    usleep(1000);
  }
  printf("%lld\n", on(CLOCK_MONOTONIC) - started);
  return 0;
}

static int console(const char *path) {
  int mode, file = open(path, O_RDWR | O_NOCTTY | O_CLOEXEC);
  if (file < 0 || ioctl(file, KDGETMODE, &mode) != 0) return fail(path);
  puts(mode == KD_TEXT ? "text" : mode == KD_GRAPHICS ? "graphics" : "neither");
  return 0;
}

int main(int count, char **words) {
  const char *form = count > 1 ? words[1] : "";
  if (!strcmp(form, "read") && count == 4) return read_loop(words[2], atol(words[3]));
  if (!strcmp(form, "hog")) for (volatile unsigned turns = 0;; turns++) {}
  if (!strcmp(form, "enosys") && count > 3) return enosys(atoi(words[2]), words + 3);
  if (!strcmp(form, "cpu") && count == 3) return processor_time(atoi(words[2]));
  if (!strcmp(form, "split") && count > 3) return split(atof(words[2]), count - 3, words + 3);
  if (!strcmp(form, "call") && count == 3)
    return syscall(atol(words[2]), -1, -1, -1, -1) < 0 && errno == ENOSYS;
  if (!strcmp(form, "now")) return printf("%lld\n", on(CLOCK_MONOTONIC)) < 0;
  if (!strcmp(form, "stamp")) return stamp();
  if (!strcmp(form, "fifo") && count > 3) return fifo(atoi(words[2]), words + 3);
  if (!strcmp(form, "seed")) return seed();
  if (!strcmp(form, "buttons")) return buttons();
  if (!strcmp(form, "frame") && count > 3) return frame(words[2], words + 3);
  if (!strcmp(form, "console") && count == 3) return console(words[2]);
  if (!strcmp(form, "random")) {
    char byte;
    puts(getrandom(&byte, 1, GRND_NONBLOCK) == 1 ? "ready" : strerror(errno));
    return 0;
  }
  fputs("usage: probe read FILE COUNT | hog | enosys FROM COMMAND... | call NUMBER | cpu PID | "
        "split SECONDS PID... | now | stamp | fifo PRIORITY COMMAND... | random | seed | buttons "
        "| frame FILE COMMAND... | console FILE\n",
        stderr);
  return 2;
}
