// A CUDA driver without a GPU. It records and computes nothing: kernels are written to a folder and counted instead of run, copies to
// the device are dropped, and every number read from the device is 2. So a program goes through all its work and asks for every kernel
// that it needs; what it computes is rubbish. (The number is 2 because host-train tries out a device with 1 + 1.)
//
// FAKE_CUDA_FOLDER receives MODULE.ptx for every module, and at the end `launches.txt`: a line `COUNT MODULE NAME` for every function.
//
//   cc -shared -fPIC -O1 -Wall -Wextra -Wno-unused-parameter -o libcuda.so.1 driver.c
//
// It has only the functions that Burn calls. Names, arguments and numbers are those of NVIDIA's cuda.h.
#include <pthread.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

typedef enum { OK = 0, OUT_OF_MEMORY = 2, NO_SUCH_DEVICE = 101, NOT_SUPPORTED = 801 } Result;
typedef void *Handle;
typedef uintptr_t Address;

typedef struct Function {
    struct Function *next;
    uintptr_t module;
    long launches;
    char name[];
} Function;

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static Function *functions;
static uintptr_t modules;
static long launches; // of all functions
static Address next_address = (Address)1 << 32;

static FILE *create(const char *name) {
    const char *folder = getenv("FAKE_CUDA_FOLDER");
    char path[4096];
    snprintf(path, sizeof path, "%s/%s", folder ? folder : ".", name);
    FILE *file = fopen(path, "w");
    if (!file) {
        fprintf(stderr, "ERROR: %s: expected a file that can be written, found none\n", path);
        exit(1);
    }
    return file;
}

__attribute__((destructor)) static void write_launches(void) {
    if (!functions) return;
    FILE *file = create("launches.txt");
    for (Function *f = functions; f; f = f->next) fprintf(file, "%ld %04zu %s\n", f->launches, (size_t)f->module, f->name);
    fclose(file);
}

// A handle for things that have no content.
static Result make(Handle *made) {
    *made = (Handle)16;
    return OK;
}

// Host memory that looks as if it came from the device.
static void twos(void *to, size_t bytes) {
    const float two = 2.0f;
    for (size_t i = 0; i + sizeof two <= bytes; i += sizeof two) memcpy((char *)to + i, &two, sizeof two);
}

// ---- Driver and device: one card with the limits of an H100.

Result cuInit(unsigned flags) { return OK; }

Result cuDriverGetVersion(int *version) {
    *version = 13000;
    return OK;
}

Result cuGetErrorName(Result error, const char **name) {
    *name = "CUDA_ERROR_FAKE";
    return OK;
}

Result cuGetErrorString(Result error, const char **text) {
    *text = "an error of the driver that only records";
    return OK;
}

Result cuDeviceGetCount(int *count) {
    *count = 1;
    return OK;
}

Result cuDeviceGet(int *device, int index) {
    *device = 0;
    return index == 0 ? OK : NO_SUCH_DEVICE;
}

Result cuDeviceGetName(char *name, int bytes, int device) {
    snprintf(name, (size_t)bytes, "NVIDIA H100 (recorder)"); // Burn looks for tensor cores by the first word
    return OK;
}

Result cuDeviceTotalMem_v2(size_t *bytes, int device) {
    *bytes = (size_t)80 << 30;
    return OK;
}

Result cuMemGetInfo_v2(size_t *free, size_t *total) {
    *free = *total = (size_t)80 << 30;
    return OK;
}

Result cuDeviceGetUuid_v2(char *uuid, int device) {
    memset(uuid, 1, 16);
    return OK;
}

Result cuDeviceGetPCIBusId(char *id, int bytes, int device) {
    snprintf(id, (size_t)bytes, "0000:01:00.0");
    return OK;
}

Result cuDeviceCanAccessPeer(int *can, int device, int peer) {
    *can = 0;
    return OK;
}

Result cuDeviceGetAttribute(int *value, int attribute, int device) {
    static const int table[][2] = {
        {1, 1024},       // threads of a block
        {2, 1024},       // its extent in x
        {3, 1024},       // in y
        {4, 64},         // in z
        {5, 2147483647}, // extent of a grid in x, blocks
        {6, 65535},      // in y
        {7, 65535},      // in z
        {8, 49152},      // shared memory of a block, bytes
        {10, 32},        // threads of a warp
        {12, 65536},     // registers of a block
        {13, 1980000},   // clock, kHz
        {16, 132},       // multiprocessors
        {36, 2619000},   // clock of the memory, kHz
        {37, 5120},      // width of its bus, bits
        {38, 52428800},  // level-2 cache, bytes
        {39, 2048},      // threads of a multiprocessor
        {75, 9},         // compute capability, major
        {76, 0},         // minor
        {81, 233472},    // shared memory of a multiprocessor, bytes
        {97, 232448},    // shared memory that a block can ask for, bytes
        {106, 32},       // blocks of a multiprocessor
    };
    *value = 1;
    for (size_t i = 0; i < sizeof table / sizeof *table; i++)
        if (table[i][0] == attribute) *value = table[i][1];
    return OK;
}

// ---- Contexts, streams, events: all work is done at once. The clock of the events counts launches, 10 microseconds each.

Result cuDevicePrimaryCtxRetain(Handle *context, int device) { return make(context); }
Result cuDevicePrimaryCtxRelease_v2(int device) { return OK; }
Result cuCtxGetCurrent(Handle *context) { return make(context); }
Result cuCtxSetCurrent(Handle context) { return OK; }
Result cuCtxSynchronize(void) { return OK; }

Result cuCtxGetStreamPriorityRange(int *least, int *greatest) {
    *least = *greatest = 0;
    return OK;
}

Result cuStreamCreate(Handle *stream, unsigned flags) { return make(stream); }
Result cuStreamCreateWithPriority(Handle *stream, unsigned flags, int priority) { return make(stream); }
Result cuStreamDestroy_v2(Handle stream) { return OK; }
Result cuStreamQuery(Handle stream) { return OK; }
Result cuStreamSynchronize(Handle stream) { return OK; }
Result cuStreamWaitEvent(Handle stream, Handle event, unsigned flags) { return OK; }

Result cuLaunchHostFunc(Handle stream, void (*function)(void *), void *data) {
    function(data);
    return OK;
}

Result cuEventCreate(long **event, unsigned flags) {
    *event = calloc(1, sizeof **event);
    return *event ? OK : OUT_OF_MEMORY;
}

Result cuEventDestroy_v2(long *event) {
    free(event);
    return OK;
}

Result cuEventRecord(long *event, Handle stream) {
    *event = __atomic_load_n(&launches, __ATOMIC_RELAXED);
    return OK;
}

Result cuEventQuery(Handle event) { return OK; }
Result cuEventSynchronize(Handle event) { return OK; }

Result cuEventElapsedTime_v2(float *ms, const long *from, const long *to) {
    *ms = 0.01f * (float)(*to - *from);
    return OK;
}

Result cuEventElapsedTime(float *ms, const long *from, const long *to) { return cuEventElapsedTime_v2(ms, from, to); }

// ---- Memory: addresses of the device are numbers without anything behind them; page-locked memory is ordinary memory.

Result cuMemAlloc_v2(Address *address, size_t bytes) {
    pthread_mutex_lock(&lock);
    *address = next_address;
    next_address += (bytes + 511) / 512 * 512;
    pthread_mutex_unlock(&lock);
    return OK;
}

Result cuMemAllocAsync(Address *address, size_t bytes, Handle stream) { return cuMemAlloc_v2(address, bytes); }
Result cuMemFree_v2(Address address) { return OK; }
Result cuMemFreeAsync(Address address, Handle stream) { return OK; }

Result cuMemAllocHost_v2(void **made, size_t bytes) {
    *made = calloc(bytes ? bytes : 1, 1);
    return *made ? OK : OUT_OF_MEMORY;
}

Result cuMemHostAlloc(void **made, size_t bytes, unsigned flags) { return cuMemAllocHost_v2(made, bytes); }

Result cuMemFreeHost(void *memory) {
    free(memory);
    return OK;
}

Result cuMemcpyHtoD_v2(Address to, const void *from, size_t bytes) { return OK; }
Result cuMemcpyHtoDAsync_v2(Address to, const void *from, size_t bytes, Handle stream) { return OK; }
Result cuMemcpyDtoDAsync_v2(Address to, Address from, size_t bytes, Handle stream) { return OK; }
Result cuMemsetD8Async(Address to, unsigned char value, size_t bytes, Handle stream) { return OK; }

Result cuMemcpyDtoH_v2(void *to, Address from, size_t bytes) {
    twos(to, bytes);
    return OK;
}

Result cuMemcpyDtoHAsync_v2(void *to, Address from, size_t bytes, Handle stream) { return cuMemcpyDtoH_v2(to, from, bytes); }

typedef struct { // one side of a copy of a rectangle
    size_t x_bytes, y;
    unsigned kind; // 1: host memory
    void *host;
    Address device;
    Handle array;
    size_t pitch;
} Side;

typedef struct {
    Side from, to;
    size_t width_bytes, height;
} Rectangle;

Result cuMemcpy2DAsync_v2(const Rectangle *copy, Handle stream) {
    const Side *to = &copy->to;
    for (size_t y = 0; to->kind == 1 && y < copy->height; y++)
        twos((char *)to->host + (to->y + y) * to->pitch + to->x_bytes, copy->width_bytes);
    return OK;
}

// ---- Kernels.

Result cuModuleLoadData(Handle *module, const void *image) {
    pthread_mutex_lock(&lock);
    uintptr_t number = ++modules;
    pthread_mutex_unlock(&lock);
    char name[32];
    snprintf(name, sizeof name, "%04zu.ptx", (size_t)number);
    FILE *file = create(name);
    fputs(image, file);
    fclose(file);
    *module = (Handle)number;
    return OK;
}

Result cuModuleLoadDataEx(Handle *module, const void *image, unsigned count, Handle options, Handle values) {
    return cuModuleLoadData(module, image);
}

Result cuModuleUnload(Handle module) { return OK; }

Result cuModuleGetFunction(Handle *function, Handle module, const char *name) {
    Function *made = calloc(1, sizeof *made + strlen(name) + 1);
    if (!made) return OUT_OF_MEMORY;
    strcpy(made->name, name);
    made->module = (uintptr_t)module;
    pthread_mutex_lock(&lock);
    made->next = functions;
    functions = made;
    pthread_mutex_unlock(&lock);
    *function = made;
    return OK;
}

Result cuFuncSetAttribute(Handle function, int attribute, int value) { return OK; }

Result cuFuncGetAttribute(int *value, int attribute, Handle function) {
    *value = 64;
    return OK;
}

Result cuOccupancyMaxActiveBlocksPerMultiprocessor(int *blocks, Handle function, int threads, size_t shared_bytes) {
    *blocks = 2;
    return OK;
}

// Burn measures the device with kernels that loop until they take long enough, by the clock of the host. One round is enough here.
static Result launch(Function *function) {
    if (strstr(function->name, "_throughput_")) nanosleep(&(struct timespec){0, 25000000}, NULL);
    __atomic_add_fetch(&function->launches, 1, __ATOMIC_RELAXED);
    __atomic_add_fetch(&launches, 1, __ATOMIC_RELAXED);
    return OK;
}

Result cuLaunchKernel(Function *function, unsigned grid_x, unsigned grid_y, unsigned grid_z, unsigned block_x, unsigned block_y,
                      unsigned block_z, unsigned shared_bytes, Handle stream, void **arguments, void **extra) {
    return launch(function);
}

Result cuLaunchCooperativeKernel(Function *function, unsigned grid_x, unsigned grid_y, unsigned grid_z, unsigned block_x,
                                 unsigned block_y, unsigned block_z, unsigned shared_bytes, Handle stream, void **arguments) {
    return launch(function);
}

Result cuLaunchKernelEx(const void *configuration, Function *function, void **arguments, void **extra) { return launch(function); }

// Descriptions of tiles for the copy engine. Only the first argument, 128 bytes, is looked at.
Result cuTensorMapEncodeTiled(void *map) {
    memset(map, 0, 128);
    return OK;
}

Result cuTensorMapEncodeIm2col(void *map) { return cuTensorMapEncodeTiled(map); }
Result cuTensorMapEncodeIm2colWide(void *map) { return cuTensorMapEncodeTiled(map); }
