/*
 * A TCG plugin that keeps a QEMU machine in step with the simulated bus, and tells what the firmware writes to registers.
 *
 * With `-icount shift=3,sleep=off` and a guest that never idles, the machine's time is its instruction count, 8 ns each. The
 * plugin counts instructions and blocks the CPU when it has used up what the bus has granted; the machine's main loop runs
 * on meanwhile, so characters can be delivered to its USARTs at an exact count.
 *
 * Arguments: socket=PATH, a Unix socket on which the bus listens; watch=FIRST-LAST in hex, any number of times: loads
 * and stores there are told. stop=ADDRESS, any number of times: a store there stops the CPU as well, before the next block of
 * instructions: what the firmware sends is to be on the wire before anything else happens.
 * To tell what instructions are for: idle=FIRST-LAST in hex, where the firmware waits for work; marks=PATH, a file with
 * such a range in each line, of code to be counted apart; handler=ADDRESS for each of the firmware's handlers: how long
 * interrupts take.
 *
 * From the bus: a count of 8 bytes, up to which the CPU may run. To the bus: messages of four words of 8 bytes, all in the
 * host's byte order: 1, count, address, value for a store; 3, count, address, 0 for a load; 2, count, idle, marked when the
 * CPU has stopped at the first block of instructions that begins at the granted count or later, with the instructions so
 * far that were in those ranges. It stops at 0 first. 4, count, address, length when the interrupt is over that began at
 * this address and took so many instructions, if it interrupted the firmware while that was waiting, or came right
 * behind one that did: else it cannot be told where it ended.
 *
 * Needs QEMU 10 (API version 4); declared here is what is used of it, so that no header of QEMU is needed.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define EXPORTED __attribute__((visibility("default")))

typedef uint64_t qemu_plugin_id_t;
typedef uint32_t qemu_plugin_meminfo_t;
struct qemu_plugin_tb;
struct qemu_plugin_insn;
struct qemu_plugin_scoreboard;
typedef struct {
    struct qemu_plugin_scoreboard *score;
    size_t offset;
} qemu_plugin_u64;
typedef struct {
    int type; /* 0 to 3: 8, 16, 32, 64 bits */
    union {
        uint8_t u8;
        uint16_t u16;
        uint32_t u32;
        uint64_t u64;
        struct {
            uint64_t low, high;
        } u128;
    } data;
} qemu_plugin_mem_value;
enum { CB_NO_REGS = 0 };
enum { COND_NE = 3, COND_GE = 7 };
enum { INLINE_ADD_U64 = 0, INLINE_STORE_U64 = 1 };
enum { MEM_RW = 3 };

struct qemu_plugin_scoreboard *qemu_plugin_scoreboard_new(size_t element_size);
uint64_t qemu_plugin_u64_get(qemu_plugin_u64 entry, unsigned int vcpu_index);
void qemu_plugin_u64_set(qemu_plugin_u64 entry, unsigned int vcpu_index, uint64_t value);
void qemu_plugin_register_vcpu_init_cb(qemu_plugin_id_t id, void (*cb)(qemu_plugin_id_t, unsigned int));
void qemu_plugin_register_vcpu_tb_trans_cb(qemu_plugin_id_t id, void (*cb)(qemu_plugin_id_t, struct qemu_plugin_tb *));
uint64_t qemu_plugin_tb_vaddr(const struct qemu_plugin_tb *tb);
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *tb);
struct qemu_plugin_insn *qemu_plugin_tb_get_insn(const struct qemu_plugin_tb *tb, size_t index);
uint64_t qemu_plugin_insn_vaddr(const struct qemu_plugin_insn *insn);
size_t qemu_plugin_insn_size(const struct qemu_plugin_insn *insn);
size_t qemu_plugin_insn_data(const struct qemu_plugin_insn *insn, void *dest, size_t len);
void qemu_plugin_register_vcpu_tb_exec_cb(struct qemu_plugin_tb *tb, void (*cb)(unsigned int, void *), int flags,
                                          void *userdata);
void qemu_plugin_register_vcpu_tb_exec_inline_per_vcpu(struct qemu_plugin_tb *tb, int op, qemu_plugin_u64 entry, uint64_t imm);
void qemu_plugin_register_vcpu_tb_exec_cond_cb(struct qemu_plugin_tb *tb, void (*cb)(unsigned int, void *), int flags,
                                               int cond, qemu_plugin_u64 entry, uint64_t imm, void *userdata);
void qemu_plugin_register_vcpu_insn_exec_inline_per_vcpu(struct qemu_plugin_insn *insn, int op, qemu_plugin_u64 entry,
                                                         uint64_t imm);
void qemu_plugin_register_vcpu_mem_cb(struct qemu_plugin_insn *insn,
                                      void (*cb)(unsigned int, qemu_plugin_meminfo_t, uint64_t, void *), int flags, int rw,
                                      void *userdata);
bool qemu_plugin_mem_is_store(qemu_plugin_meminfo_t info);
qemu_plugin_mem_value qemu_plugin_mem_get_value(qemu_plugin_meminfo_t info);

EXPORTED int qemu_plugin_version = 4;

struct message {
    uint64_t kind, count, address, value;
};
enum { STORE = 1, STOPPED = 2, LOAD = 3, INTERRUPT = 4 };

/*
 * What is compiled into each block compares with a constant, so the counter runs up to this from as far below as was granted.
 */
#define FULL (UINT64_C(1) << 62)

static qemu_plugin_u64 counter;
static uint64_t granted;

/* Instructions that wait, and those that are marked. */
static qemu_plugin_u64 idle_counter, marked_counter;
/* Whether the last block of instructions was one that waits; whether an interrupt is under way whose length is wanted. */
static qemu_plugin_u64 was_idle, is_timed;
/* Its address, and the count at which it began. */
static uint64_t timed_address, timed_since;
static int bus = -1;

struct range {
    uint64_t first, last;
};
static struct range watched[16];
static size_t watched_len;
static uint64_t stops[8];
static size_t stops_len;
static struct range idle = {1, 0};
static struct range marks[4096];
static size_t marks_len;
static uint64_t handlers[128];
static size_t handlers_len;

static bool is_in(struct range range, uint64_t address)
{
    return range.first <= address && address <= range.last;
}

static struct message pending[256];
static size_t pending_len;

static uint64_t count_now(unsigned int vcpu)
{
    return granted + (qemu_plugin_u64_get(counter, vcpu) - FULL);
}

static void all(ssize_t (*step)(int, void *, size_t), void *data, size_t len)
{
    char *at = data;
    while (len > 0) {
        ssize_t done = step(bus, at, len);
        if (done <= 0) {
            /* The bus is gone. */
            _exit(0);
        }
        at += done;
        len -= (size_t)done;
    }
}

static ssize_t write_some(int to, void *data, size_t len)
{
    return send(to, data, len, MSG_NOSIGNAL);
}

static void tell(struct message message)
{
    pending[pending_len++] = message;
    if (pending_len == sizeof pending / sizeof *pending || message.kind == STOPPED) {
        all(write_some, pending, pending_len * sizeof *pending);
        pending_len = 0;
    }
}

static void on_full(unsigned int vcpu, void *unused)
{
    (void)unused;
    uint64_t count = count_now(vcpu);
    tell((struct message){STOPPED, count, qemu_plugin_u64_get(idle_counter, vcpu), qemu_plugin_u64_get(marked_counter, vcpu)});
    do {
        all((ssize_t(*)(int, void *, size_t))read, &granted, sizeof granted);
    } while (granted <= count);
    qemu_plugin_u64_set(counter, vcpu, FULL - (granted - count));
}

static uint64_t word_of(qemu_plugin_meminfo_t info)
{
    qemu_plugin_mem_value value = qemu_plugin_mem_get_value(info);
    switch (value.type) {
    case 0:
        return value.data.u8;
    case 1:
        return value.data.u16;
    case 2:
        return value.data.u32;
    default:
        return value.data.u64;
    }
}

static void on_access(unsigned int vcpu, qemu_plugin_meminfo_t info, uint64_t address, void *unused)
{
    (void)unused;
    for (size_t i = 0; i < watched_len; i++) {
        if (!is_in(watched[i], address)) {
            continue;
        }
        uint64_t count = count_now(vcpu);
        if (!qemu_plugin_mem_is_store(info)) {
            tell((struct message){LOAD, count, address, 0});
            return;
        }
        tell((struct message){STORE, count, address, word_of(info)});
        for (size_t k = 0; k < stops_len; k++) {
            if (address == stops[k] && count < granted) {
                granted = count;
                qemu_plugin_u64_set(counter, vcpu, FULL);
            }
        }
        return;
    }
}

static void end_interrupt(unsigned int vcpu, uint64_t count)
{
    if (qemu_plugin_u64_get(is_timed, vcpu)) {
        tell((struct message){INTERRUPT, count, timed_address, count - timed_since});
    }
    qemu_plugin_u64_set(is_timed, vcpu, 0);
}

/* Back in the loop that waits. */
static void on_idle(unsigned int vcpu, void *unused)
{
    (void)unused;
    end_interrupt(vcpu, count_now(vcpu));
}

static void on_handler(unsigned int vcpu, void *handler)
{
    uint64_t count = count_now(vcpu);
    bool is_from_idle = qemu_plugin_u64_get(was_idle, vcpu) || qemu_plugin_u64_get(is_timed, vcpu);
    end_interrupt(vcpu, count);
    timed_address = *(uint64_t *)handler;
    timed_since = count;
    qemu_plugin_u64_set(is_timed, vcpu, is_from_idle);
}

static void on_start(qemu_plugin_id_t id, unsigned int vcpu)
{
    (void)id;
    qemu_plugin_u64_set(counter, vcpu, FULL);
}

/* An instruction of 16 bits; 0 for others. */
static uint16_t code_of(const struct qemu_plugin_insn *insn)
{
    uint16_t code = 0;
    bool is_short = qemu_plugin_insn_size(insn) == sizeof code && qemu_plugin_insn_data(insn, &code, sizeof code) == sizeof code;
    return is_short ? code : 0;
}

/* NOP, encoding T1 (ARMv7-M A7.7.88): firmware that has nothing to do goes through many of them. */
static bool is_nop(const struct qemu_plugin_insn *insn)
{
    return code_of(insn) == 0xBF00;
}

/* POP with PC, encoding T1, or BX LR (ARMv7-M A7.7.99, A7.7.20): behind it the firmware waits no more. */
static bool is_return(const struct qemu_plugin_insn *insn)
{
    uint16_t code = code_of(insn);
    return code >> 8 == 0xBD || code == 0x4770;
}

/* What a block is for, by where it begins. */
static void look_at_block(struct qemu_plugin_tb *tb)
{
    uint64_t address = qemu_plugin_tb_vaddr(tb);
    for (size_t i = 0; i < handlers_len; i++) {
        if (address == handlers[i]) {
            qemu_plugin_register_vcpu_tb_exec_cb(tb, on_handler, CB_NO_REGS, &handlers[i]);
            /* What was before is still to be seen there. */
            return;
        }
    }
    bool is_idle = is_in(idle, address);
    if (handlers_len > 0) {
        bool goes_on = is_idle && !is_return(qemu_plugin_tb_get_insn(tb, qemu_plugin_tb_n_insns(tb) - 1));
        qemu_plugin_register_vcpu_tb_exec_inline_per_vcpu(tb, INLINE_STORE_U64, was_idle, goes_on);
    }
    if (handlers_len > 0 && is_idle) {
        qemu_plugin_register_vcpu_tb_exec_cond_cb(tb, on_idle, CB_NO_REGS, COND_NE, is_timed, 0, NULL);
    }
}

static void count_apart(struct qemu_plugin_insn *insn, uint64_t count)
{
    uint64_t address = qemu_plugin_insn_vaddr(insn);
    if (is_in(idle, address)) {
        qemu_plugin_register_vcpu_insn_exec_inline_per_vcpu(insn, INLINE_ADD_U64, idle_counter, count);
    }
    for (size_t i = 0; i < marks_len; i++) {
        if (is_in(marks[i], address)) {
            qemu_plugin_register_vcpu_insn_exec_inline_per_vcpu(insn, INLINE_ADD_U64, marked_counter, count);
            return;
        }
    }
}

static void on_translation(qemu_plugin_id_t id, struct qemu_plugin_tb *tb)
{
    (void)id;
    qemu_plugin_register_vcpu_tb_exec_cond_cb(tb, on_full, CB_NO_REGS, COND_GE, counter, FULL, NULL);
    look_at_block(tb);
    size_t len = qemu_plugin_tb_n_insns(tb);
    for (size_t i = 0; i < len; i++) {
        struct qemu_plugin_insn *insn = qemu_plugin_tb_get_insn(tb, i);
        /* Each by itself: a block may be left half way. But not between instructions that do nothing. */
        uint64_t count = 1;
        while (is_nop(insn) && i + 1 < len && is_nop(qemu_plugin_tb_get_insn(tb, i + 1))) {
            count++;
            i++;
        }
        qemu_plugin_register_vcpu_insn_exec_inline_per_vcpu(insn, INLINE_ADD_U64, counter, count);
        count_apart(insn, count);
        if (!is_nop(insn)) {
            qemu_plugin_register_vcpu_mem_cb(insn, on_access, CB_NO_REGS, MEM_RW, NULL);
        }
    }
}

static bool read_marks(const char *path)
{
    FILE *file = fopen(path, "r");
    if (file == NULL) {
        return false;
    }
    unsigned long long first, last;
    int found;
    while ((found = fscanf(file, "%llx-%llx\n", &first, &last)) == 2 && marks_len < sizeof marks / sizeof *marks) {
        marks[marks_len++] = (struct range){first, last};
    }
    fclose(file);
    return found == EOF;
}

EXPORTED int qemu_plugin_install(qemu_plugin_id_t id, const void *info, int argc, char **argv)
{
    (void)info;
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    for (int i = 0; i < argc; i++) {
        unsigned long long first, last;
        if (strncmp(argv[i], "socket=", 7) == 0 && strlen(argv[i] + 7) < sizeof address.sun_path) {
            strcpy(address.sun_path, argv[i] + 7);
        } else if (sscanf(argv[i], "watch=%llx-%llx", &first, &last) == 2 &&
                   watched_len < sizeof watched / sizeof *watched) {
            watched[watched_len++] = (struct range){first, last};
        } else if (sscanf(argv[i], "idle=%llx-%llx", &first, &last) == 2) {
            idle = (struct range){first, last};
        } else if (sscanf(argv[i], "handler=%llx", &first) == 1 && handlers_len < sizeof handlers / sizeof *handlers) {
            handlers[handlers_len++] = first;
        } else if (strncmp(argv[i], "marks=", 6) == 0) {
            if (!read_marks(argv[i] + 6)) {
                fprintf(stderr, "barrier: no ranges, or too many, in %s\n", argv[i] + 6);
                return 1;
            }
        } else if (sscanf(argv[i], "stop=%llx", &first) == 1 && stops_len < sizeof stops / sizeof *stops) {
            stops[stops_len++] = first;
        } else {
            fprintf(stderr, "barrier: what is %s?\n", argv[i]);
            return 1;
        }
    }
    bus = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (bus < 0 || connect(bus, (struct sockaddr *)&address, sizeof address) != 0) {
        perror("barrier: socket");
        return 1;
    }
    qemu_plugin_u64 *entries[] = {&counter, &idle_counter, &marked_counter, &was_idle, &is_timed};
    size_t len = sizeof entries / sizeof *entries;
    struct qemu_plugin_scoreboard *score = qemu_plugin_scoreboard_new(len * sizeof(uint64_t));
    for (size_t i = 0; i < len; i++) {
        *entries[i] = (qemu_plugin_u64){score, i * sizeof(uint64_t)};
    }
    qemu_plugin_register_vcpu_init_cb(id, on_start);
    qemu_plugin_register_vcpu_tb_trans_cb(id, on_translation);
    return 0;
}
