/* A drive as a Modbus TCP server of libmodbus.
 *
 *     libmodbus_drive PORT
 *
 * Registers are typed from the interface manual of the Hyundai N700: run at 0002, frequency at 0004, output frequency at
 * 0101, frequency setting at 0201, sources of frequency and run command (3: communication) at 0211 and 0212. The output
 * follows at once. Every register from 0220 on holds its own address, so that a reader sees whether it got the one that
 * it asked for. It serves one connection at a time, and prints each write.
 */

#include <errno.h>
#include <modbus.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

enum { RUN = 0x0002, FREQUENCY = 0x0004, OUTPUT = 0x0101, SETTING = 0x0201, SOURCES = 0x0211, OWN_FROM = 0x0220, REGISTERS = 0x0300 };

static void serve(modbus_t *ctx, modbus_mapping_t *map)
{
    uint8_t query[MODBUS_TCP_MAX_ADU_LENGTH];

    for (;;) {
        int length = modbus_receive(ctx, query);
        if (length < 0)
            return;
        if (length == 0)
            continue;
        const uint8_t *pdu = query + modbus_get_header_length(ctx);
        if (modbus_reply(ctx, query, length, map) < 0)
            return;
        if (pdu[0] == MODBUS_FC_WRITE_SINGLE_REGISTER) {
            printf("{\"wrote\": %d, \"word\": %d}\n", pdu[1] << 8 | pdu[2], pdu[3] << 8 | pdu[4]);
            fflush(stdout);
        }
        uint16_t *words = map->tab_registers;
        words[SETTING] = words[FREQUENCY];
        words[OUTPUT] = words[RUN] == 1 || words[RUN] == 2 ? words[FREQUENCY] : 0;
    }
}

int main(int argc, char **argv)
{
    modbus_t *ctx = modbus_new_tcp("127.0.0.1", argc > 1 ? atoi(argv[1]) : 1502);
    modbus_mapping_t *map = modbus_mapping_new(0, 0, REGISTERS, 0);
    if (ctx == NULL || map == NULL)
        return 1;
    for (int address = OWN_FROM; address < REGISTERS; address++)
        map->tab_registers[address] = address;
    map->tab_registers[SOURCES] = map->tab_registers[SOURCES + 1] = 3;
    int listener = modbus_tcp_listen(ctx, 1);
    if (listener < 0)
        return 1;
    printf("{\"plays\": \"n700\"}\n");
    fflush(stdout);
    for (;;) {
        if (modbus_tcp_accept(ctx, &listener) < 0)
            return 1;
        serve(ctx, map);
        modbus_close(ctx);
    }
}
