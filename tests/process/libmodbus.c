/* libmodbus as a client, with what applies of its own test client.
 *
 *     libmodbus PORT UNIT
 *     libmodbus DEVICE UNIT
 *
 * With a DEVICE it is a serial master, and runs the library's functions alone.
 *
 * Debian ships that client as an example of libmodbus-dev. The most of its `main` assumes the memory of the server that
 * comes with it: coils and registers that keep whatever is written. Its `test_server`, which sends crafted requests and
 * wants the exact exceptions, holds for any server and runs here as it is, with the unit's number instead of 255.
 * Behind it stand the library's functions, on the uniform unit of a drive.
 */

#include <errno.h>
#include <modbus.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static int unit;

/* What the client takes from its own unit-test.h. */
#define _UNIT_TEST_H_
#define SERVER_ID 17
#define INVALID_SERVER_ID 18
const uint16_t UT_BITS_ADDRESS = 0, UT_BITS_NB = 4, UT_BITS_ADDRESS_INVALID_REQUEST_LENGTH = 2;
const uint8_t UT_BITS_TAB[] = {0};
const uint16_t UT_INPUT_BITS_ADDRESS = 0, UT_INPUT_BITS_NB = 16;
const uint8_t UT_INPUT_BITS_TAB[] = {0, 0};
const uint16_t UT_REGISTERS_ADDRESS = 0, UT_REGISTERS_NB = 3, UT_REGISTERS_NB_MAX = 32, UT_REGISTERS_TAB[] = {0, 0, 0};
const uint16_t UT_REGISTERS_ADDRESS_SPECIAL = 0, UT_REGISTERS_ADDRESS_INVALID_TID_OR_SLAVE = 0;
const uint16_t UT_REGISTERS_ADDRESS_SLEEP_500_MS = 0, UT_REGISTERS_ADDRESS_BYTE_SLEEP_5_MS = 0;
const uint16_t UT_REGISTERS_NB_SPECIAL = 2;
const uint16_t UT_INPUT_REGISTERS_ADDRESS = 0, UT_INPUT_REGISTERS_NB = 1, UT_INPUT_REGISTERS_TAB[] = {0};
const float UT_REAL = 0;
const uint8_t UT_IREAL_ABCD_SET[4], UT_IREAL_DCBA_SET[4], UT_IREAL_BADC_SET[4], UT_IREAL_CDAB_SET[4];
const uint16_t UT_IREAL_ABCD_GET[2], UT_IREAL_DCBA_GET[2], UT_IREAL_BADC_GET[2], UT_IREAL_CDAB_GET[2];
#undef MODBUS_TCP_SLAVE
#define MODBUS_TCP_SLAVE unit

#define main all_of_it
#include "unit-test-client.c"
#undef main

static int failures;
static int is_serial;

static void expect(const char *what, int is_right, int rc)
{
    int why = errno;

    printf("%s: %s\n", what, is_right ? "OK" : "FAILED");
    if (!is_right) {
        printf("  returned %d, %s\n", rc, modbus_strerror(why));
        failures++;
    }
}

#define EXPECT_COUNT(call, count) do { int rc = (call); expect(#call, rc == (count), rc); } while (0)
#define EXPECT_REFUSED(call, why) do { int rc = (call); expect(#call, rc == -1 && errno == (why), rc); } while (0)

static void functions(modbus_t *ctx)
{
    uint8_t bits[MODBUS_MAX_READ_BITS] = {0};
    uint16_t words[MODBUS_MAX_READ_REGISTERS] = {0}, setpoint = 2600;

    EXPECT_COUNT(modbus_read_bits(ctx, 0, 4, bits), 4);
    EXPECT_COUNT(modbus_read_input_bits(ctx, 0, 16, bits), 16);
    expect("online", bits[0] == ON, bits[0]);
    EXPECT_COUNT(modbus_read_registers(ctx, 0, 32, words), 32);
    expect("version of the map", words[0] == 1, words[0]);
    EXPECT_COUNT(modbus_read_input_registers(ctx, 20, 2, words), 2);
    expect("limits", words[0] == 500 && words[1] == 5000, words[0]);
    EXPECT_COUNT(modbus_write_register(ctx, 257, 3000), 1);
    EXPECT_COUNT(modbus_read_registers(ctx, 257, 1, words), 1);
    expect("setpoint", words[0] == 3000, words[0]);
    words[0] = 2500, words[1] = 1;
    EXPECT_COUNT(modbus_write_registers(ctx, 257, 2, words), 2);
    EXPECT_COUNT(modbus_mask_write_register(ctx, 257, 0xFF00, 0x00C8), 1);
    EXPECT_COUNT(modbus_read_registers(ctx, 257, 1, words), 1);
    expect("masked setpoint", words[0] == 2504, words[0]);
    EXPECT_COUNT(modbus_write_and_read_registers(ctx, 257, 1, &setpoint, 257, 1, words), 1);
    expect("setpoint written, then read", words[0] == 2600, words[0]);
    EXPECT_COUNT(modbus_write_bit(ctx, 3, ON), 1);
    bits[0] = bits[1] = bits[2] = OFF, bits[3] = ON;
    EXPECT_COUNT(modbus_write_bits(ctx, 0, 4, bits), 4);

    EXPECT_REFUSED(modbus_read_bits(ctx, 0, 5, bits), EMBXILADD);
    EXPECT_REFUSED(modbus_read_input_bits(ctx, 16, 1, bits), EMBXILADD);
    EXPECT_REFUSED(modbus_read_registers(ctx, 39, 2, words), EMBXILADD);
    EXPECT_REFUSED(modbus_read_input_registers(ctx, 65535, 1, words), EMBXILADD);
    EXPECT_REFUSED(modbus_write_register(ctx, 0, 1), EMBXILADD);
    EXPECT_REFUSED(modbus_write_register(ctx, 257, 499), EMBXILVAL);
    EXPECT_REFUSED(modbus_write_bit(ctx, 4, ON), EMBXILADD);
    bits[0] = bits[1] = ON;
    EXPECT_REFUSED(modbus_write_bits(ctx, 0, 2, bits), EMBXILVAL);
    EXPECT_REFUSED(modbus_report_slave_id(ctx, sizeof bits, bits), EMBXILFUN);
    EXPECT_REFUSED(modbus_read_registers(ctx, 0, MODBUS_MAX_READ_REGISTERS + 1, words), EMBMDATA);
    modbus_set_slave(ctx, INVALID_SERVER_ID);
    if (is_serial) {
        /* It may be another slave's: the gateway does not answer. */
        modbus_set_response_timeout(ctx, 0, 500000);
        EXPECT_REFUSED(modbus_read_registers(ctx, 0, 1, words), ETIMEDOUT);
    } else {
        EXPECT_REFUSED(modbus_read_registers(ctx, 0, 1, words), EMBXGPATH);
    }
}

int main(int argc, char *argv[])
{
    modbus_t *ctx;

    is_serial = argc == 3 && argv[1][0] == '/';
    ctx = is_serial ? modbus_new_rtu(argv[1], 9600, 'N', 8, 1) : modbus_new_tcp("127.0.0.1", argc == 3 ? atoi(argv[1]) : 0);
    unit = argc == 3 ? atoi(argv[2]) : 0;
    modbus_set_slave(ctx, unit);
    modbus_set_response_timeout(ctx, 6, 0);
    if (modbus_connect(ctx) == -1) {
        printf("Connection failed: %s\n", modbus_strerror(errno));
        return 1;
    }
    if (!is_serial && test_server(ctx, TCP) == -1) {
        failures++;
    }
    modbus_set_response_timeout(ctx, 6, 0);
    functions(ctx);
    modbus_close(ctx);
    modbus_free(ctx);
    printf("%s\n", failures == 0 ? "ALL THAT APPLIES PASSES" : "SOMETHING FAILED");
    return failures == 0 ? 0 : 1;
}
